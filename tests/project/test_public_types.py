"""Type checks of a user's script with all public names of `hfa`, by mypy and pyright."""

from __future__ import annotations

import os
import re
import subprocess
import sys
from importlib.util import find_spec
from pathlib import Path

import pytest
from project import FOLDERS

import hfa

SCRIPT = (Path(__file__).parents[1] / "support" / "user_script.py").read_text("utf-8")
#: Folders in a user's import path.
FOLDERS_ABOVE = {folder.parent for folder in FOLDERS.values()}
#: Lines that a type checker must report, at the end of the script.
WRONG = (
    "text: str = linear.A",
    "hfa.solve(model)",
    "hfa.game(linear, Q=1, R='a', delta='b')",
    "hfa.from_derivatives(3)",
    "hfa.LinearModel([[1.0]], [[1.0]])",
    "hfa.verify(game, [[1.0]])",
    "hfa.fly(model, point, x0=point.states)",
    "point.states = 1",
)
#: Line numbers of the wrong lines.
AT_END = [str(SCRIPT.count("\n") + 1 + place) for place in range(len(WRONG))]


def errors_of(tool: str, folder: Path, *options: str) -> list[str]:
    """Return the numbers of the lines of the script in which a type checker reports an error.

    tool: "mypy" or "pyright"
    """
    (folder / "script.py").write_text(SCRIPT + "\n".join(WRONG) + "\n", encoding="utf-8")
    done = subprocess.run(
        [sys.executable, "-m", tool, *options, "script.py"],
        cwd=folder,
        env={**os.environ, "MYPYPATH": os.pathsep.join(map(str, FOLDERS_ABOVE))},
        capture_output=True,
        text=True,
        timeout=600,
    )
    return re.findall(r"script\.py:(\d+).*error", done.stdout)


def test_the_script_uses_every_public_name() -> None:
    """The script for the type checkers uses every public name of `hfa`."""
    used = set(re.findall(r"\bhfa\.(\w+)", SCRIPT))
    assert {*hfa.__all__} - used == set()


@pytest.mark.slow
def test_mypy_accepts_the_script(tmp_path: Path) -> None:
    """mypy --strict reports only the planted errors at the end of the script."""
    pytest.importorskip("mypy")
    found = errors_of("mypy", tmp_path, "--strict", "--follow-imports=silent")
    assert list(dict.fromkeys(found)) == AT_END


@pytest.mark.slow
@pytest.mark.skipif(find_spec("pyright") is None, reason="pyright is not installed")
def test_pyright_accepts_the_script(tmp_path: Path) -> None:
    """Pyright reports only the planted errors at the end of the script."""
    paths = ", ".join(f'"{path}"' for path in sorted(FOLDERS_ABOVE))
    (tmp_path / "pyrightconfig.json").write_text(f'{{"extraPaths": [{paths}]}}')
    found = errors_of("pyright", tmp_path, "--pythonpath", sys.executable)
    assert list(dict.fromkeys(found)) == AT_END
