"""Tests import the public faces of packages: what `import PACKAGE` offers, and these modules.

`inner_imports.toml` names the exceptions, which attack what they import.
"""

import ast
import tomllib
from fnmatch import filter as fnmatch_all

import pytest
from project import FOLDERS, ROOT

#: Modules that are public in addition to the packages: entry points for users and other packages.
PUBLIC = {"hfa.paper", "hfa.extend", "hfa.main", "hfa.exit_codes", "hfa.entry_points"}
PUBLIC |= {"hfa_support.errors"}
#: Patterns of test files that may import inner modules.
EXCEPTIONS = tomllib.loads((ROOT / "tests" / "project" / "inner_imports.toml").read_text("utf-8"))[
    "attacks"
]


def inner_imports(source):
    """Return the inner modules and private names of the packages that a file imports."""
    found = set()
    for node in ast.walk(ast.parse(source)):
        if isinstance(node, ast.Import):
            imported = [(alias.name, "") for alias in node.names]
        elif isinstance(node, ast.ImportFrom) and not node.level:
            imported = [(str(node.module), alias.name) for alias in node.names]
        else:
            continue
        for module, name in imported:
            package = module.partition(".")[0]
            if package not in FOLDERS:
                continue
            # "from trim import tables" imports the module trim.tables.
            path = FOLDERS[package].parent.joinpath(*module.split("."), f"{name}.py")
            whole = f"{module}.{name}" if path.exists() else module
            if whole not in FOLDERS and whole not in PUBLIC:
                found.add(whole)
            if name.startswith("_"):
                found.add(f"{module}.{name}")
    return found


def files():
    """Return the test files and their helpers, relative to the root."""
    paths = [*ROOT.glob("tests/**/*.py"), *ROOT.glob("extensions/*/tests/**/*.py")]
    return sorted(str(path.relative_to(ROOT)) for path in paths)


@pytest.mark.slow
def test_no_other_test_imports_inner_modules():
    """A test file that imports an inner module of a package (one that is not public) matches a
    pattern of `EXCEPTIONS`, and each pattern is needed by at least one such file.
    """
    importers = [name for name in files() if inner_imports((ROOT / name).read_text("utf-8"))]
    excepted = {pattern: fnmatch_all(importers, pattern) for pattern in EXCEPTIONS}
    assert set(importers) == set().union(*excepted.values())
    assert [pattern for pattern, found in excepted.items() if not found] == []
