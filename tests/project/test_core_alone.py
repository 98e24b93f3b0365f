"""The core works without extensions. `make test-core` runs all its tests in this way."""

import json
import subprocess
import sys

import pytest
from project import ROOT

CORE_ALONE = str(ROOT / "tests" / "core_alone.py")
TESTS = ("tests/trim/point/test_solve.py", "tests/verification/critic/test_verdict.py")

#: Command lines, and a program that prints the exit code and output of each.
LINES = (
    "--help",
    "trim --help",
    "solve --help more",
    "sweep --help more",
    "verify --help more",
    "trim --dihedral 10",
    "trim --dihedral 10 --dynamics unsteady",
    "trim --aircraft jsbsim:737",
    "fly --dihedral 15",
    "trim --aircraft x.dml",
    "prove schedule --dihedral 15:16",
)
PROGRAM = """
import contextlib, io, json
from hfa.main import main
answers = []
for words in {lines}:
    out = io.StringIO()
    with contextlib.redirect_stdout(out), contextlib.redirect_stderr(out):
        code = main(words)
    answers.append((code, out.getvalue()))
print(json.dumps(answers))
"""


@pytest.mark.slow
def test_tests_of_the_core_pass_without_extensions():
    """A sample of the core's tests passes in an environment without extensions."""
    words = [sys.executable, CORE_ALONE, "-n", "0", "-m", "not slow", *TESTS]
    done = subprocess.run(words, capture_output=True, text=True, timeout=300, check=False)
    assert done.returncode == 0, done.stdout[-2000:]
    assert " passed" in done.stdout


@pytest.mark.slow
def test_the_core_trims_without_extensions(tmp_path):
    """Without extensions, the core trims, and names of extensions are refused in one line.

    These names are commands, options, aircraft formats and public functions. The help
    does not mention them.
    """
    sys.path.insert(0, str(ROOT / "tests"))
    try:
        from core_alone import environment
    finally:
        sys.path.remove(str(ROOT / "tests"))
    python = environment(tmp_path / "core")
    lines = [words.split() for words in LINES]
    program = PROGRAM.format(lines=lines)

    def run_without_extensions(program, check):
        """Run a Python program in the environment without extensions.

        The current folder is not the project's folder, which may contain metadata of entry points.
        """
        words = [python, "-c", program]
        return subprocess.run(words, cwd=tmp_path, capture_output=True, text=True, check=check)

    done = run_without_extensions(program, check=True)
    names = "from hfa import *; import hfa; print('fly' in dir(hfa), 'Model' in dir(hfa)); hfa.fly"
    refused = run_without_extensions(names, check=False)
    assert refused.stdout == "False True\n"
    assert "hfa.fly requires the package hfa_flight; install this package" in refused.stderr
    answers = dict(zip(LINES, json.loads(done.stdout), strict=True))

    def run(*words):
        return tuple(answers[" ".join(words)])

    code, output = run("--help")
    assert (code, "  verify " in output, "  fly " in output) == (0, True, False)
    assert run("trim", "--dihedral", "10")[0] == 0
    code, output = run("fly", "--dihedral", "15")
    assert (code, output.count("\n")) == (2, 1)
    assert "unknown command 'fly'" in output
    for line, message in (
        ("trim --aircraft x.dml", "x.dml"),
        ("prove schedule --dihedral 15:16", "unknown command 'prove'"),
    ):
        code, output = run(*line.split())
        assert (code, output.count("\n")) == (2, 1), output
        assert message in output
    code, output = run("trim", "--aircraft", "jsbsim:737")
    assert (code, output.count("\n")) == (2, 1)
    helps = "".join(output for line, (_, output) in answers.items() if "--help" in line)
    of_others = (".fmu", "jsbsim", ".dml")
    assert [word for word in of_others if word in helps] == []
    of_the_core = (
        "unsteady",
        "--discount",
        ".zarr",
        ".onnx",
        "--limit-cost",
    )
    assert [word for word in of_the_core if word not in helps] == []
    assert run("trim", "--dihedral", "10", "--dynamics", "unsteady")[0] == 0
