"""The core names what is missing without extensions. `make test-core` runs all its tests so."""

import subprocess
import sys

import pytest
from cli import results_in_turn
from project import ROOT

#: Command line -> exit code, and words that the printed text contains.
EXPECTED = {
    "--help": (0, ["  verify "]),
    "trim --dihedral 10 --dynamics unsteady": (0, ["trimmed"]),
    "trim --aircraft jsbsim:737": (2, ["jsbsim"]),
    "trim --aircraft x.dml": (2, ["x.dml"]),
    "fly --dihedral 15": (2, ["unknown command 'fly'"]),
}
#: Words of extensions, which no help of the core contains.
EXTENSION_WORDS = ("  fly ", ".fmu", "jsbsim", ".dml")


@pytest.mark.slow
def test_the_core_trims_without_extensions(tmp_path):
    """Without extensions, commands of the core print `EXPECTED`; commands, aircraft formats and
    public functions of extensions are refused in one line that names what is missing, and no help
    mentions them.
    """
    sys.path.insert(0, str(ROOT / "tests"))
    try:
        from core_alone import environment
    finally:
        sys.path.remove(str(ROOT / "tests"))
    python = environment(tmp_path / "core")
    results = results_in_turn([f"hfa {line}" for line in EXPECTED], tmp_path, python)
    for (line, (code, words)), result in zip(EXPECTED.items(), results, strict=True):
        output = result.out + result.err
        assert result.code == code, (line, output)
        assert all(word in output for word in words), (line, output)
        if code:
            assert output.count("\n") == 1, output
        if "--help" in line:
            assert [word for word in EXTENSION_WORDS if word in output] == []

    # A public function. The star import must not need hfa_flight, which `hfa.fly` requires.
    # The current folder is not that of the project, which may have metadata of entry points.
    names = "from hfa import *; import hfa; print('fly' in dir(hfa), 'Model' in dir(hfa)); hfa.fly"
    refused = subprocess.run([python, "-c", names], cwd=tmp_path, capture_output=True, text=True)
    assert refused.stdout == "False True\n"
    assert "hfa.fly requires the package hfa_flight; install this package" in refused.stderr
