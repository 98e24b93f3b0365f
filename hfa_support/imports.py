"""Names that a Python file or stub imports."""

from __future__ import annotations

from functools import cache


@cache
def origins_in(path: str) -> dict[str, tuple[str, str]]:
    """Return name -> (module that defines it, its name in the module), for the names that a file
    imports. The second is "" for a module itself.
    """
    import ast

    origins = {}
    with open(path, encoding="utf-8") as file:
        tree = ast.parse(file.read())
    for statement in ast.walk(tree):
        if isinstance(statement, ast.ImportFrom):
            dots = "." * statement.level
            for alias in statement.names:
                public = alias.asname or alias.name
                if statement.module is None:
                    origins[public] = (dots + alias.name, "")
                else:
                    origins[public] = (dots + statement.module, alias.name)
        elif isinstance(statement, ast.Import):
            origins |= {alias.asname or alias.name: (alias.name, "") for alias in statement.names}
    return origins
