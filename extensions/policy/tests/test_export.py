"""Export of a deployment file to C, compared with the command in Python."""

import ctypes
import subprocess

import numpy as np
import pytest
from policy_cases import AIRCRAFT, FOLDER, trims

from hfa.main import main
from hfa_flight.policies.deployment.policy import flown_deployment
from hfa_support.native.machine_code import c_compiler

needs_compiler = pytest.mark.skipif(c_compiler() is None, reason="no C compiler")


def exported(name, point, target):
    where = AIRCRAFT[name][0]
    value = getattr(point.states, "speed")  # noqa: B009
    words = ["export", "--policy", str(FOLDER / f"{name}.toml"), "--aircraft", where]
    return main([*words, "--at", repr(float(value)), "-o", str(target)])


def differences(policy, command):
    """Return the largest difference between an exported command and the deployment's command.

    Both commands are evaluated at random states and inputs about the trim. The difference is
    divided by the nominal values of the inputs.

    command: function (X, previous U) -> U
    """
    model = policy.deployed.model
    random = np.random.default_rng(0)
    states = [signal.nominal for signal in model.states.values()]
    inputs = [signal.nominal for signal in model.inputs.values()]
    trim = policy.deployed.trim_vector(policy.point)
    largest = 0.0
    for size in (0.0, 0.1, 1.0, 10.0):
        X = np.array(policy.point.states) + size * random.uniform(-1, 1, len(states)) * states
        U = np.array(policy.point.inputs) + size * random.uniform(-1, 1, len(inputs)) * inputs
        expected = np.array(policy.deployed.command(X, U, trim)).ravel()
        largest = max(largest, np.abs((command(X, U) - expected) / inputs).max())
    return largest


def compiled(folder):
    """Compile the exported C in a folder, and return the command as a function (X, previous U)
    -> U.
    """
    library = folder / "policy.so"
    words = [c_compiler(), "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-fPIC", "-shared"]
    source = folder / "deployed_policy.c"
    subprocess.run([*words, str(source), "-o", str(library), "-lm"], check=True)
    call = ctypes.CDLL(str(library)).deployed_policy
    pointer = ctypes.POINTER(ctypes.c_double)

    def command(X, U):
        out = np.zeros(len(U))
        call(*(array.ctypes.data_as(pointer) for array in (X, U, out)))
        return out

    return command


@needs_compiler
@pytest.mark.parametrize(
    "name", ["ppo_gtm", "td3_gtm", pytest.param("ppo_c172", marks=pytest.mark.slow)]
)
def test_exported_c_equals_the_deployment_file(name, tmp_path, capsys):
    """The exported C code gives the commands of the deployment file, and nan for a measurement of
    nan.
    """
    point = trims(name)[0]
    assert exported(name, point, tmp_path / "c") == 0
    policy = flown_deployment(FOLDER / f"{name}.toml", point)
    command = compiled(tmp_path / "c")
    assert differences(policy, command) < 1e-12
    measured = np.array(point.states)
    measured[list(point.model.states).index("pitch")] = np.nan
    moved = [list(point.model.inputs).index(each) for each in policy.deployed.commanded]
    assert np.isnan(command(measured, np.array(point.inputs))[moved]).all()
    header = (tmp_path / "c" / "deployed_policy.h").read_text()
    assert f"#define POLICY_DT {policy.deployed.deployment.dt!r}" in header


def test_an_fmu_of_a_deployment_file_is_refused(tmp_path, capsys):
    """An FMU, which has neither sample time nor delay, is refused with the right export."""
    target = tmp_path / "policy.fmu"
    assert exported("ppo_gtm", trims("ppo_gtm")[0], target) == 2
    assert "give a folder for C source" in capsys.readouterr().err
    assert not target.exists()


def test_law_is_refused_with_a_deployment_file(tmp_path, capsys):
    """`hfa export` refuses --law together with --policy."""
    words = [
        "export",
        "--policy",
        str(FOLDER / "ppo_gtm.toml"),
        "--aircraft",
        AIRCRAFT["ppo_gtm"][0],
    ]
    assert main([*words, "--law", "exact", "-o", str(tmp_path / "c")]) == 2
    assert "--law has no effect with --policy" in capsys.readouterr().err
