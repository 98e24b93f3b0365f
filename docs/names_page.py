"""Generator of the reference pages: one page of public names for each package."""

from __future__ import annotations

import ast
import importlib
import inspect
import json
import re
from collections import Counter
from functools import cache
from itertools import takewhile
from pathlib import Path

from docstrings import describe_attributes, escaped
from sphinx.pycode import ModuleAnalyzer

ROOT = Path(__file__).parent.parent
#: Package -> subtitle of its reference page.
PACKAGES = {
    "hfa": "what a script needs",
    "hfa.paper": "the paper's level flight, game and parameters",
    "hfa.extend": "what a package of your own imports",
    "hfa_model": "the flexible aircraft",
    "hfa_aircraft": "models of aircraft",
    "trim": "trims and linear models",
    "controller": "games, critics and learning",
    "verification": "checks",
    "hfa_flight": "flights of the nonlinear aircraft",
    "hfa_prove": "certificates",
}


def names_of(package: str) -> list[str]:
    """Return the public names that a package has a page for, sorted by decreasing number of
    `users`: those in its stub, without classes that an earlier package exports too.
    """
    public = exported(package)
    earlier = takewhile(lambda other: other != package, PACKAGES)
    described = [value_of(other, name) for other in earlier for name in exported(other)]
    names = [name for name in public if not _is_class_of(described, value_of(package, name))]
    return sorted(names, key=lambda name: -users()[name])


def exported(package: str) -> list[str]:
    """Return the public names in the stub of a package."""
    names = [
        alias.asname or alias.name for statement in imports_of(package) for alias in statement.names
    ]
    return [name for name in names if not name.startswith("_")]


def _is_class_of(values: list[object], value: object) -> bool:
    """Return whether a value is a class that is among some values."""
    return isinstance(value, type) and any(value is other for other in values)


def imports_of(package: str) -> list[ast.ImportFrom]:
    """Return the import statements "from MODULE import NAME" in the stub of a package."""
    folder = Path(inspect.getfile(importlib.import_module(package))).parent
    stub = ast.parse((folder / "__init__.pyi").read_text("utf-8"))
    return [entry for entry in stub.body if isinstance(entry, ast.ImportFrom) and entry.module]


@cache
def users() -> Counter[str]:
    """Return for each name the number of documents and examples whose code calls the name."""
    code = [path.read_text("utf-8") for path in (ROOT / "examples").glob("*.py")]
    for path in (ROOT / "README.md", *(ROOT / "docs").glob("*.md")):
        blocks = re.findall(r"^```python\n(.*?)^```$", path.read_text("utf-8"), re.M | re.S)
        code.append("\n".join(blocks))
    for path in (ROOT / "examples").glob("*.ipynb"):
        cells = json.loads(path.read_text("utf-8"))["cells"]
        code.append("\n".join("".join(cell["source"]) for cell in cells))
    return Counter(name for text in code for name in set(re.findall(r"\w+(?=\()", text)))


def value_of(package: str, name: str) -> object:
    """Return the object that a package exports under this name."""
    return getattr(importlib.import_module(package), name)


def names_page(package: str) -> str:
    """Return the reference page of a package.

    The page contains a table of the public names with the first sentences of their descriptions,
    and an entry for each name. It also contains an entry for each class without a public name that
    `results` lists.
    """
    names = names_of(package)
    rows = [_row(package, name) for name in names]
    entries = [_entry(package, name) for name in names]
    returned = [
        _class_entry(f"{kind.__module__}.{kind.__qualname__}", kind) for kind in results()[package]
    ]
    table = ".. list-table::\n   :class: names\n\n" + "".join(rows)
    parts = [f"# `{package}`: {PACKAGES[package]}", _restructured([table, *entries])]
    if returned:
        parts += ["## Results", _restructured(returned)]
    return "\n\n".join(parts)


def _restructured(parts: list[str]) -> str:
    """Return reStructuredText as a block of a Markdown page."""
    return "```{eval-rst}\n" + "\n".join(parts) + "```\n"


@cache
def results() -> dict[str, list[type]]:
    """Return package -> classes without a public name that its public functions return.

    Each class is listed once, under the first package whose functions return it.
    """
    known = [value_of(package, name) for package in PACKAGES for name in exported(package)]
    classes: dict[str, list[type]] = {package: [] for package in PACKAGES}
    for package in PACKAGES:
        for name in names_of(package):
            function = inspect.unwrap(value_of(package, name))
            if not inspect.isfunction(function):
                continue
            for word in re.findall(r"\w+", str(function.__annotations__.get("return", ""))):
                kind = function.__globals__.get(word)
                is_ours = isinstance(kind, type) and kind.__module__.split(".")[0] in PACKAGES
                if is_ours and kind not in known:
                    classes[package].append(kind)
                    known.append(kind)
    return classes


def _row(package: str, name: str) -> str:
    """Return the row of a public name in the table: link, and first sentence of its docstring."""
    paragraph = " ".join(takewhile(str.strip, _text(package, name)))
    sentence = re.split(r"(?<=\w\.) (?=[A-Z])", paragraph)[0]
    return f"   * - :py:obj:`{name} <{package}.{name}>`\n     - {escaped([sentence])[0]}\n"


def _text(package: str, name: str) -> list[str]:
    """Return the docstring, or the comment above the definition, of an exported name, as lines."""
    value = value_of(package, name)
    if isinstance(value, type) or inspect.isroutine(value):
        return (inspect.getdoc(value) or "").splitlines()
    statement = next(
        statement
        for statement in imports_of(package)
        if name in (alias.name for alias in statement.names)
    )
    module = statement.module or ""
    if statement.level:
        module = f"{package}.{module}"
    return ModuleAnalyzer.for_module(module).find_attr_docs().get(("", name), [])


def _entry(package: str, name: str) -> str:
    """Return the directive of Sphinx that documents a public name."""
    value = value_of(package, name)
    if isinstance(value, type):
        return _class_entry(f"{package}.{name}", value)
    if inspect.isroutine(value):
        return f".. autofunction:: {package}.{name}\n"
    lines = "\n".join(f"   {line}" for line in escaped(_text(package, name)))
    return f".. py:data:: {package}.{name}\n\n{lines}\n"


def _class_entry(name: str, owner: type) -> str:
    """Return the directive of a class, and register the descriptions of its attributes."""
    for base in owner.__mro__:
        if base.__module__.partition(".")[0] in PACKAGES:
            describe_attributes(base)
    return f".. autoclass:: {name}\n   :members:\n   :undoc-members:\n"
