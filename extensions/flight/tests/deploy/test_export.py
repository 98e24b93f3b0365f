"""Export of a deployment file to C, compared with the command in Python."""

import ctypes
import shutil
import subprocess

import numpy as np
import pytest
from policy_cases import AIRCRAFT, FOLDER, stored_deployment, trims

from hfa.main import main
from hfa_flight import Deployed

COMPILER = shutil.which("cc")
needs_compiler = pytest.mark.skipif(COMPILER is None, reason="no C compiler")


def exported(name, point, target, file=None):
    """Export a deployment file as C to a folder, and return the exit code.

    name: name of a test policy, whose aircraft and, by default, deployment file are used
    """
    file = file or FOLDER / f"{name}.toml"
    words = ["export", "--policy", str(file), "--aircraft", AIRCRAFT[name][0]]
    return main([*words, "--at", repr(float(point["speed"])), "-o", str(target)])


def differences(deployed, point, command):
    """Return the largest difference between an exported command and the deployment's command.

    Both commands are evaluated at random states and inputs about the trim. The difference is
    divided by the nominal values of the inputs.

    command: function (X, previous U) -> U
    """
    model = deployed.model
    random = np.random.default_rng(0)
    states = [signal.nominal for signal in model.states.values()]
    inputs = [signal.nominal for signal in model.inputs.values()]
    trim = deployed.trim_vector(point)
    largest = 0.0
    for size in (0.0, 0.1, 1.0, 10.0):
        X = np.array(point.states) + size * random.uniform(-1, 1, len(states)) * states
        U = np.array(point.inputs) + size * random.uniform(-1, 1, len(inputs)) * inputs
        expected = np.array(deployed.command(X, U, trim)).ravel()
        largest = max(largest, np.abs((command(X, U) - expected) / inputs).max())
    return largest


def compiled(folder):
    """Compile the exported C in a folder, and return the command as a function (X, previous U)
    -> U.
    """
    library = folder / "policy.so"
    words = [COMPILER, "-std=c99", "-Wall", "-Wextra", "-Werror", "-O1", "-fPIC", "-shared"]
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
@pytest.mark.parametrize("name", ["td3_gtm", pytest.param("ppo_c172", marks=pytest.mark.slow)])
def test_exported_c_equals_the_deployment_file(name, tmp_path):
    """The exported C code gives the commands of the deployment file, and nan for a measurement of
    nan.
    """
    point = trims(name)[0]
    assert exported(name, point, tmp_path / "c") == 0
    deployed = Deployed(stored_deployment(name), point.model)
    command = compiled(tmp_path / "c")
    assert differences(deployed, point, command) < 1e-12
    measured = np.array(point.states)
    measured[list(point.model.states).index("pitch")] = np.nan
    commanded = [list(point.model.inputs).index(name) for name in deployed.commanded]
    assert np.isnan(command(measured, np.array(point.inputs))[commanded]).all()
    header = (tmp_path / "c" / "deployed_policy.h").read_text()
    timing = deployed.deployment
    assert f"POLICY_DT {timing.dt!r}\n#define POLICY_DELAY {timing.delay!r}\n" in header
