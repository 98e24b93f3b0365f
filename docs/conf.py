"""Sphinx configuration: pages of commands, formats and public names are generated from the code at
every build."""

from __future__ import annotations

import ast
import importlib
import inspect
import re
import runpy
import shutil
from pathlib import Path
from typing import Any

from sphinx.pycode import ModuleAnalyzer

import hfa_model
from hfa.main import COMMANDS, command_named, filled
from hfa.options.parser import Parser
from hfa_support.version import VERSION

DOCS = Path(__file__).parent
GENERATED = DOCS / "generated"
#: Package -> what its page of the reference is about.
PACKAGES = {
    "hfa_aircraft": "aircraft as models",
    "hfa_support": "errors and reports",
    "hfa_model": "the flexible aircraft",
    "trim": "trims and linear models",
    "controller": "games, laws and flights",
    "verification": "checks and proofs",
}

project = "hfa"
author = "the authors of hfa"
release = VERSION
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "sphinx.ext.mathjax"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"hfa {VERSION}"
html_static_path = ["_static"]
html_css_files = ["wide_tables.css"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
autodoc_typehints = "signature"
autodoc_typehints_format = "short"
python_maximum_signature_line_length = 80
autodoc_preserve_defaults = True
# Types of other libraries and of rooms without a page of their own lead nowhere.
nitpick_ignore_regex = [("py:(class|obj|data)", ".*")]
autodoc_member_order = "bysource"
# Docstrings are plain text with backquoted names, not reStructuredText roles.
default_role = "literal"
suppress_warnings = ["misc.highlighting_failure"]


def commands_page() -> str:
    """The complete help of every command."""
    aircraft = hfa_model.aircraft()
    parts = ["# Commands"]
    for name in COMMANDS:
        parser = filled(Parser(prog=f"hfa {name}"), command_named(name), aircraft)
        parts.append(f"## hfa {name}\n\n```text\n{parser.format_help(more=True).strip()}\n```")
    return "\n\n".join(parts) + "\n"


def names_of(package: str) -> list[tuple[str, str]]:
    """(module, name) of each public name of a package, from its stub."""
    stub = ast.parse(
        (Path(importlib.import_module(package).__file__ or "").parent / "__init__.pyi").read_text(
            "utf-8"
        )
    )
    found = [node for node in stub.body if isinstance(node, ast.ImportFrom)]
    return [
        (f"{package}.{node.module}", each.asname or each.name)
        for node in found
        for each in node.names
    ]


def names_page(package: str) -> str:
    """Every public name of a package with its docstring; of a constant, the comment above it."""
    entries = []
    for module, name in names_of(package):
        found = getattr(importlib.import_module(package), name)
        if isinstance(found, type):
            entries.append(f".. autoclass:: {package}.{name}\n   :members:\n   :undoc-members:\n")
        elif inspect.isroutine(found):
            entries.append(f".. autofunction:: {package}.{name}\n")
        else:
            lines = ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name), [])
            entries.append(
                "\n   ".join([f".. py:data:: {package}.{name}", "", *escaped(lines)]) + "\n"
            )
    return f"# `{package}`: {PACKAGES[package]}\n\n```{{eval-rst}}\n" + "\n".join(entries) + "```\n"


def escaped(lines: list[str]) -> list[str]:
    """Docstrings are plain text: what reStructuredText would take for markup is escaped outside of
    backquotes."""
    parts = (re.split(r"(`[^`]*`)", line) for line in lines)
    return [
        "".join(
            re.sub(r"([*|_\\])", r"\\\1", part) if i % 2 == 0 else part
            for i, part in enumerate(each)
        )
        for each in parts
    ]


def notebook_page(path: Path) -> str:
    """An executed notebook as Markdown; its pictures become files of the same folder."""
    import base64
    import json

    parts = []
    for number, cell in enumerate(json.loads(path.read_text("utf-8"))["cells"]):
        source = "".join(cell["source"])
        parts.append(source if cell["cell_type"] == "markdown" else f"```python\n{source}\n```")
        for output in cell.get("outputs", ()):
            data = output.get("data", {})
            if "image/png" in data:
                picture = f"{path.stem}_{number}.png"
                (GENERATED / picture).write_bytes(base64.b64decode("".join(data["image/png"])))
                parts.append(f"![Figure drawn by the code above]({picture})")
            elif text := "".join(output.get("text", data.get("text/plain", ""))):
                parts.append(f"```text\n{text.rstrip()}\n```")
    return "\n\n".join(parts) + "\n"


def generate() -> None:
    """Write the generated pages anew."""
    shutil.rmtree(GENERATED, ignore_errors=True)
    GENERATED.mkdir()
    pages = {
        "commands": commands_page(),
        "formats": runpy.run_path(str(DOCS / "formats_page.py"))["formats_page"](),
    }
    pages |= {package: names_page(package) for package in PACKAGES}
    pages |= {
        path.stem: notebook_page(path)
        for path in sorted((DOCS.parent / "examples").glob("*.ipynb"))
    }
    for name, text in pages.items():
        (GENERATED / f"{name}.md").write_text(text, "utf-8")


generate()


def setup(app: Any) -> None:
    """Plain docstrings, and links to files of the repository that are no pages."""
    app.connect(
        "autodoc-process-docstring",
        lambda _app, _what, _name, _of, _options, lines: _replace(lines),
    )
    app.connect("autodoc-process-signature", _short_signature)
    app.connect("source-read", _without_links_to_the_repository)


def _replace(lines: list[str]) -> None:
    lines[:] = with_lists(escaped(lines))


#: "values: (N, k), all combinations": an argument or an attribute, or several, and what it is.
_ENTRY = re.compile(r"^(?P<names>[A-Za-z][\w, ()\\]*): (?P<text>.*)$")


def with_lists(lines: list[str]) -> list[str]:
    """Arguments and attributes, one a line in docstrings, as the entries of a list.

    A continuation of an entry is indented deeper than the entry."""
    result: list[str] = []
    in_list = False
    for line in lines:
        entry = _ENTRY.match(line)
        if entry is not None:
            if not in_list:
                result.append("")
            in_list = True
            result.append(f"- **{entry['names']}**: {entry['text']}")
        elif in_list and line.startswith(" "):
            result.append(f"  {line.strip()}")
        else:
            if in_list and line:
                result.append("")
            in_list = False
            result.append(line)
    return result


def _short_signature(
    _app: Any, _what: str, _name: str, found: Any, _options: Any, given: str | None, returned: Any
) -> Any:
    """Defaults that are objects are left out: a whole aircraft would be shown."""
    if given is None or len(given) < 200 or not callable(found):
        return given, returned
    return "(" + ", ".join(inspect.signature(found).parameters) + ")", returned


def _without_links_to_the_repository(_app: Any, _page: str, source: list[str]) -> None:
    source[0] = re.sub(r"\[([^\]]+)\]\(\.\./([^)#]+)[^)]*\)", r"\1 (`\2`)", source[0])
