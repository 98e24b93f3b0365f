"""Type checks of a user's script with all public names of `hfa`, by mypy and pyright."""

from __future__ import annotations

import json
import os
import re
import subprocess
import sys
from collections.abc import Mapping
from importlib.util import find_spec
from pathlib import Path

import pytest
from project import FOLDERS, ROOT

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


def scripts_of_documents() -> dict[str, str]:
    """Return name -> Python code of each document and notebook."""
    found = {}
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        blocks = re.findall(r"^```python\n(.*?)^```", path.read_text("utf-8"), re.S | re.M)
        if blocks:
            found[f"doc_{path.stem.lower()}.py"] = "\n\n".join(blocks)
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        cells = json.loads(path.read_text("utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        found[f"notebook_{path.stem}.py"] = re.sub(r"^%.*$", "", "\n\n".join(code), flags=re.M)
    return found


#: Parts of messages on documents that concern no name of this project: optional results that a
#: document knows to exist, and NumPy's declaration of savez.
ELSEWHERE = ("None", '"savez"', '"Parameters"')


def document_errors(folder: Path, scripts: Mapping[str, str]) -> list[str]:
    """Return the errors of mypy --strict in scripts, apart from `ELSEWHERE`."""
    for name, text in scripts.items():
        (folder / name).write_text(text, encoding="utf-8")
    options = ("--strict", "--follow-imports=silent", "--ignore-missing-imports")
    done = subprocess.run(
        [
            sys.executable,
            "-m",
            "mypy",
            *options,
            "--allow-untyped-defs",
            "--allow-untyped-calls",
            *scripts,
        ],
        cwd=folder,
        env={**os.environ, "MYPYPATH": os.pathsep.join(map(str, FOLDERS_ABOVE))},
        capture_output=True,
        text=True,
        timeout=600,
    )
    errors = [line for line in done.stdout.splitlines() if " error: " in line]
    return [line for line in errors if not any(words in line for words in ELSEWHERE)]


@pytest.mark.slow
def test_mypy_accepts_the_documents(tmp_path: Path) -> None:
    """mypy --strict accepts every call in documents and notebooks, and reports a planted one."""
    pytest.importorskip("mypy")
    scripts = scripts_of_documents()
    assert len(scripts) > 10
    assert document_errors(tmp_path, scripts) == []
    planted = {"doc_planted.py": "import hfa\nhfa.trim(hfa.aircraft()).zeta\n"}
    assert len(document_errors(tmp_path, planted)) == 1


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
