"""`make test-matrix`: the same numbers with the oldest and newest versions of the dependencies, Python by Python.

Each environment is a folder of its own: the oldest Python with the lower bounds of pyproject.toml, each Python with the
newest versions that have wheels. The same commands are run in each; their numbers are compared with those of the
environment that runs this, and then a quick part of the tests is run.

    python tests/support/matrix.py [--folder FOLDER] [--reference FILE] [--no-tests] [PYTHON ...]
"""

from __future__ import annotations

import argparse
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
import tomllib
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np

ROOT = Path(__file__).parents[2]
#: Pythons that are looked for, the oldest first.
PYTHONS = ("python3.11", "python3.12", "python3.13", "python3.14", "python3.15")
#: What is installed at its lower bound: all that a user installs. Tools of the tests are always the newest.
EXTRAS = ("distributed", "page", "proof", "completion")
TOOLS = (
    *("pytest", "pytest-xdist", "hypothesis", "jsonschema", "mpmath", "setuptools>=70.1"),
    *("ambiance", "coverage", "fmpy", "xarray"),
)
#: Commands that print numbers of every part.
COMMANDS = {
    "printed pairs": ("regenerate", "--json"),
    "sweep": ("sweep", "--dihedral", "0:20:1", "--json"),
    "linear": ("linearize", "--dihedral", "10", "--dynamics", "newton", "--json"),
    "game": ("solve", "--dihedral", "15", "--json"),
    "design": ("solve", "--dihedral", "15", "--design", "simvfa-1", "--json"),
    "learning": ("learn", "--dihedral", "15", "--law", "certified", "--json"),
    "flight": ("fly", "--dihedral", "15", "--duration", "5", "--initial", "dihedral=2", "--json"),
    "proof": ("prove", "schedule", "--dihedral", "14:15", "--json"),
}
TESTS = (
    *("tests/hfa_model", "tests/trim/linear", "tests/trim/sweeps", "tests/controller/riccati/test_gare.py"),
    *("tests/cli/test_files.py", "tests/verification/checker/test_checker.py", "tests/controller/flight"),
)
#: Of the largest number beside it.
TOLERANCE = 1e-10
#: Differences of equal numbers, which are rounding, and what is another one each time.
LEFT_OUT = ("provenance", "residuals", "half_units", "percent", "drift_misfit")


def requirements(project: dict[str, Any]) -> list[str]:
    """What pyproject.toml asks for of a user, with lower bounds."""
    optional = project["optional-dependencies"]
    return [*project["dependencies"], *(each for extra in EXTRAS for each in optional[extra])]


def oldest(requirement: str) -> str:
    """The same requirement at its lower bound."""
    return requirement.replace(">=", "==")


def numbers(value: Any, path: str = "") -> Iterator[tuple[str, np.ndarray]]:
    """Every number of JSON data, those of one list or of one column of a table together, with where it stands.

    Of a check, which is mostly of what rounding leaves, whether it is passed.
    """
    if isinstance(value, dict) and {"limit", "ok"} <= value.keys():
        yield f"{path}/ok", np.array([float(value["ok"])])
    elif isinstance(value, dict):
        for name, each in value.items():
            if name not in LEFT_OUT:
                yield from numbers(each, f"{path}/{name}")
    elif isinstance(value, list):
        flat = np.array(list(_flat(value)), dtype=float)
        if flat.size:
            yield path, flat
        columns: dict[str, list[np.ndarray]] = {}
        for each in value:
            if isinstance(each, dict):
                for where, found in numbers(each, path):
                    columns.setdefault(where, []).append(found)
        yield from ((where, np.concatenate(found)) for where, found in columns.items())
    elif isinstance(value, (int, float)) and not isinstance(value, bool):
        yield path, np.array([value], dtype=float)


def _flat(value: list[Any]) -> Iterator[float]:
    for each in value:
        if isinstance(each, list):
            yield from _flat(each)
        elif isinstance(each, (int, float)) and not isinstance(each, bool):
            yield each


def differences(found: dict[str, Any], expected: dict[str, Any]) -> list[str]:
    """Where the numbers differ by more than the tolerance, and by how much."""
    ours, theirs = dict(numbers(found)), dict(numbers(expected))
    result = [f"{path}: only in one of them" for path in sorted(ours.keys() ^ theirs.keys())]
    for path in ours.keys() & theirs.keys():
        first, second = ours[path], theirs[path]
        if first.shape != second.shape:
            result.append(f"{path}: {first.size} numbers instead of {second.size}")
        elif not np.allclose(first, second, rtol=0.0, atol=TOLERANCE * np.nanmax(np.abs(second)), equal_nan=True):
            worst = np.abs(first - second).max() / np.nanmax(np.abs(second))
            result.append(f"{path}: differs by {worst:.1e} of the largest")
    return sorted(result)


def environment(folder: Path, python: str, wanted: list[str]) -> Path:
    """The interpreter of a new environment with these requirements and this project; kept where it is the same."""
    kept = folder / "requirements"
    text = "\n".join([python, *wanted, *TOOLS])
    if not kept.exists() or kept.read_text() != text:
        shutil.rmtree(folder, ignore_errors=True)
        _checked([python, "-m", "venv", str(folder)])
        install = [str(folder / "bin/python"), "-m", "pip", "install", "--quiet", "--disable-pip-version-check"]
        _checked([*install, "--only-binary", ":all:", *wanted, *TOOLS])
        _checked([*install, "--no-deps", "--no-build-isolation", "--editable", str(ROOT)])
        kept.write_text(text)
    return folder / "bin/python"


def answers(python: Path) -> dict[str, Any]:
    """What the commands print with this interpreter."""
    with tempfile.TemporaryDirectory() as empty:
        place = {**os.environ, "OPENBLAS_NUM_THREADS": "1"}
        return {
            name: json.loads(_checked([str(python), "-P", "-m", "hfa_cli", *words], folder=empty, place=place))
            for name, words in COMMANDS.items()
        }


def _checked(words: list[str], folder: str | None = None, place: dict[str, str] | None = None) -> str:
    done = subprocess.run(words, cwd=folder, env=place, capture_output=True, text=True)
    if done.returncode:
        raise SystemExit(f"{' '.join(words)}: exit code {done.returncode}\n{done.stdout[-1500:]}{done.stderr[-1500:]}")
    return done.stdout


def main() -> int:
    """Make the environments, compare their numbers, run the tests in them; 1 where anything differs or fails."""
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("pythons", nargs="*", metavar="PYTHON", help="the oldest first; default: all found")
    parser.add_argument("--folder", type=Path, default=Path("out/matrix"), help="environments and the reference")
    parser.add_argument("--reference", type=Path, help="numbers of another run (FOLDER/reference.json)")
    parser.add_argument("--no-tests", action="store_true", help="compare numbers only")
    options = parser.parse_args()
    folder = options.folder.resolve()
    folder.mkdir(parents=True, exist_ok=True)
    if options.reference is None:
        (folder / "reference.json").write_text(json.dumps(answers(Path(sys.executable))))
    expected = json.loads((options.reference or folder / "reference.json").read_bytes())
    newest = requirements(tomllib.loads((ROOT / "pyproject.toml").read_text())["project"])
    pythons = options.pythons or [each for each in PYTHONS if shutil.which(each)]
    runs = [(pythons[0], "oldest", [oldest(each) for each in newest]), *((each, "newest", newest) for each in pythons)]
    failed = 0
    for python, name, wanted in runs:
        version = _checked([python, "-c", "import platform; print(platform.python_version())"]).strip()
        inside = environment(folder / f"{version}-{name}", python, wanted)
        found = differences(answers(inside), expected)
        print(f"Python {version}, {name}: {_installed(inside, wanted)}\n  numbers: {found or 'equal'}", flush=True)
        failed += bool(found)
        if not options.no_tests:
            words = [str(inside), "-m", "pytest", "-m", "not slow", "-n", "0", "-p", "no:cacheprovider", *TESTS]
            failed += bool(subprocess.run(words, cwd=ROOT).returncode)
    return int(failed > 0)


def _installed(python: Path, wanted: list[str]) -> str:
    names = [re.split(r"[>=<;\[]", each)[0] for each in wanted]
    text = "import sys; from importlib.metadata import version; print(*(f'{n} {version(n)}' for n in sys.argv[1:]))"
    return _checked([str(python), "-c", text, *names]).strip()


if __name__ == "__main__":
    sys.exit(main())
