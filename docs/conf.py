"""Sphinx configuration.

The pages of commands, notebooks and public names are generated at every build.
"""

from __future__ import annotations

import importlib
import re
import shutil
import sys
from pathlib import Path
from typing import Any

from hfa.entry_points import commands
from hfa.main import parser_of
from hfa_support.version import VERSION

DOCS = Path(__file__).parent
sys.path.insert(0, str(DOCS))
import docstrings  # noqa: E402
from names_page import PACKAGES, names_page  # noqa: E402
from notebook_page import notebook_page  # noqa: E402

GENERATED = DOCS / "generated"
MATHJAX = Path(
    importlib.import_module("sphinx-mathjax-offline").__path__[0], "static", "mathjax", "tex-svg.js"
)
project = "hfa"
author = project_copyright = "the authors of hfa"
release = VERSION
extensions = ["myst_parser", "sphinx.ext.autodoc", "sphinx.ext.viewcode", "sphinx.ext.mathjax"]
source_suffix = {".md": "markdown"}
exclude_patterns = ["_build"]
html_theme = "furo"
html_title = f"hfa {VERSION}"
# MathJax and its fonts are in one local file, so that equations need no network.
html_static_path = ["_static", str(MATHJAX)]
mathjax_path = MATHJAX.name
html_css_files = ["site.css"]
myst_enable_extensions = ["dollarmath"]
myst_heading_anchors = 4
autodoc_typehints = "description"
autodoc_typehints_description_target = "documented_params"
toc_object_entries_show_parents = "hide"
autodoc_typehints_format = "short"
autodoc_preserve_defaults = True
# Types of other libraries, and of packages without a page, are not links.
nitpick_ignore_regex = [("py:(class|obj|data)", ".*")]
autodoc_member_order = "bysource"
# Names in backquotes become links if they have an entry.
default_role = "py:obj"
smartquotes_action = "D"
suppress_warnings = ["misc.highlighting_failure"]


def commands_page() -> str:
    """Return a Markdown page with the complete help of every command."""
    parts = ["# Commands"]
    for name, entry in commands().items():
        parser = parser_of(entry.load(), f"hfa {name}")
        parts.append(f"## hfa {name}\n\n```text\n{parser.format_help(more=True).strip()}\n```")
    return "\n\n".join(parts) + "\n"


def generate() -> None:
    """Write all generated pages into their folder. The previous content of the folder is
    deleted.
    """
    shutil.rmtree(GENERATED, ignore_errors=True)
    GENERATED.mkdir()
    pages = {"commands": commands_page()}
    pages |= {package: names_page(package) for package in PACKAGES}
    pages |= {
        path.stem: notebook_page(path)
        for path in sorted((DOCS.parent / "examples").glob("*.ipynb"))
    }
    for name, text in pages.items():
        (GENERATED / f"{name}.md").write_text(text, "utf-8")


generate()


def setup(app: Any) -> None:
    """Register the conversion of docstrings and of links, and the removal of dead links, with
    Sphinx.
    """
    app.connect("autodoc-process-docstring", docstrings.read)
    app.connect("source-read", _without_links_to_the_repository)
    app.connect("build-finished", _remove_dead_links)


def _without_links_to_the_repository(_app: Any, _page: str, source: list[str]) -> None:
    """Replace links to files outside docs/ in a page by their texts and paths, and those to notebooks
    by links to their pages (`source-read`).
    """
    folder = "" if _page.startswith(GENERATED.name) else f"{GENERATED.name}/"
    notebooks = r"\]\(\.\./examples/(\w+)\.ipynb"
    source[0] = re.sub(notebooks, rf"]({folder}\1.md", source[0])
    source[0] = re.sub(r"\[([^\]]+)\]\(\.\./([^)#]+)[^)]*\)", r"\1 (`\2`)", source[0])


def _remove_dead_links(app: Any, error: Exception | None) -> None:
    """Remove the links from source pages to anchors that do not exist in the reference."""
    if error is not None:
        return
    anchors: dict[Path, set[str]] = {}
    for page in Path(app.outdir, "_modules").rglob("*.html"):

        def kept(link: re.Match[str], folder: Path = page.parent) -> str:
            """Return a link, or "" if its target has no such anchor."""
            target = (folder / link[1]).resolve()
            if target not in anchors:
                anchors[target] = set(re.findall(r'\bid="([^"]+)"', target.read_text("utf-8")))
            return link[0] if link[2] in anchors[target] else ""

        text = page.read_text("utf-8")
        linked = re.sub(r'<a class="viewcode-back" href="([^"#]+)#([^"]+)">[^<]*</a>', kept, text)
        page.write_text(linked, "utf-8")
