"""The core works without extensions. `make test-core` runs all its tests in this way."""

import subprocess
import sys

import pytest
from cli import results_in_turn
from project import ROOT

CORE_ALONE = str(ROOT / "tests" / "core_alone.py")
TESTS = ("tests/trim/point/test_solve.py", "tests/verification/critic/test_verdict.py")

#: Command lines whose results show what the core does without extensions.
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
    results = results_in_turn([f"hfa {line}" for line in LINES], tmp_path, python)
    answers = {
        line: (result.code, result.out + result.err)
        for line, result in zip(LINES, results, strict=True)
    }
    # The current folder is not that of the project, which may have metadata of entry points.
    names = "from hfa import *; import hfa; print('fly' in dir(hfa), 'Model' in dir(hfa)); hfa.fly"
    refused = subprocess.run([python, "-c", names], cwd=tmp_path, capture_output=True, text=True)
    assert refused.stdout == "False True\n"
    assert "hfa.fly requires the package hfa_flight; install this package" in refused.stderr

    def run(*words):
        return answers[" ".join(words)]

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
