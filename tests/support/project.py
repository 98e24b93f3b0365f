"""The folders of the project and the source code of its packages."""

import tomllib
from pathlib import Path

ROOT = Path(__file__).parents[2]
_PYPROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))
SETTINGS = _PYPROJECT["tool"]
#: Package -> folder, for the core and the extensions. mypy also checks studies and benchmarks.
FOLDERS = {
    name: next(path for path in (ROOT / name, *ROOT.glob(f"extensions/*/{name}")) if path.is_dir())
    for name in SETTINGS["mypy"]["packages"]
    if name not in ("studies", "benchmarks")
}
#: Packages with a stub of public names.
PACKAGES = tuple(name for name, folder in FOLDERS.items() if (folder / "__init__.pyi").exists())
