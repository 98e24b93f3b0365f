"""Nox session of `make test-matrix`: every Python, with the oldest and newest dependencies.

Each session installs this project with its extras, at the lower bounds in pyproject.toml or at the
newest versions that have wheels. It compares results of commands with those in .venv and runs some
of the tests.
"""

from __future__ import annotations

import json
import os
import subprocess

import nox
import numpy as np

nox.options.error_on_missing_interpreters = False
PROJECT = nox.project.load_toml("pyproject.toml")["project"]
EXTRAS = ("distributed", "page")
TOOLS = ("pytest", "pytest-xdist", "setuptools>=70.1", "ambiance", "xarray")
#: Command -> arrays in its JSON output that are compared.
COMMANDS = {
    "sweep --dihedral 0:20:1": ("A", "B", "operating_inputs"),
    "linearize --dihedral 10 --dynamics newton": ("A", "B"),
    "solve --dihedral 15": ("P", "K"),
    "solve --dihedral 5,10,15": ("P", "K"),
    "learn --dihedral 15": ("P", "K"),
}
TESTS = (
    *(
        "tests/hfa_model",
        "tests/trim/linear",
        "tests/trim/sweeps",
        "tests/controller/riccati/test_gare.py",
    ),
    *("extensions/prove/tests/schedules/test_clauses.py", "extensions/flight/tests"),
)
#: Largest difference, relative to the largest number of an array.
TOLERANCE = 1e-10


def arrays(python: str, command: str) -> dict[str, np.ndarray]:
    """Return the arrays in the JSON output of a command of `hfa`, name -> array.

    python: Python interpreter that runs the command
    command: a key of `COMMANDS`, which lists the names of the arrays
    """
    words = [python, "-P", "-m", "hfa", *command.split(), "--json"]
    data = json.loads(subprocess.run(words, check=True, capture_output=True, text=True).stdout)
    return {name: np.array(data[name], dtype=float) for name in COMMANDS[command]}


@nox.session(python=["3.11", "3.12", "3.13", "3.14"])
@nox.parametrize("versions", ["oldest", "newest"])
def matrix(session: nox.Session, versions: str) -> None:
    """Install the dependencies, compare results of commands with those in .venv, and run tests.

    versions: "oldest" or "newest". The oldest versions are tested only with the oldest Python.
    """
    if versions == "oldest" and session.python != "3.11":
        session.skip("the lower bounds have wheels for the oldest Python")
    optional = PROJECT["optional-dependencies"]
    wanted = [*PROJECT["dependencies"], *(each for extra in EXTRAS for each in optional[extra])]
    if versions == "oldest":
        wanted = [each.replace(">=", "==") for each in wanted]
    session.install("--only-binary", ":all:", *wanted, *TOOLS)
    session.install("--no-deps", "--no-build-isolation", "--editable", ".")
    for command in COMMANDS:
        ours, theirs = (
            arrays(python, command) for python in (".venv/bin/python", f"{session.bin}/python")
        )
        for name, array in ours.items():
            off = np.abs(array - theirs[name]).max() / np.abs(array).max()
            if not off <= TOLERANCE:
                session.error(f"hfa {command}: {name} differs by {off:.1e} of its largest number")
    session.run(
        "pytest",
        "-m",
        "not slow",
        "-n",
        "0",
        "-p",
        "no:cacheprovider",
        *TESTS,
        env=dict(os.environ),
    )
