"""Regions of deployment files: proved, checked and refused."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from pendulum_deployment import pendulum_deployment

import hfa
from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_prove.commands.policies import _deployment

PENDULUM = ["--aircraft", "examples/pendulum.py:PENDULUM", "--Q", "1,1", "--R", "1"]


def options_of_deployment(folder: Path, observed: str = "rate", gain: float = -0.98) -> list[str]:
    """Return the options for a deployment file with the policy u = -1.98 angle + gain observed.

    observed: name of the second observation
    """
    timing = "[timing]\ndt = 0.02\ndelay = 0.04\n"
    path = pendulum_deployment(folder, timing, observed=observed, gain=gain)
    return ["prove", "region", *PENDULUM, "--policy", str(path)]


def test_the_continuous_policy_equals_the_unsampled_file(tmp_path: Path) -> None:
    """The policy of the proof equals the deployment file's policy without sampling.

    Both policies are evaluated at (0.1 rad, -0.3 rad/s). The effects that the proof neglects are
    stated.
    """
    file = Path(options_of_deployment(tmp_path)[-1])
    model = load_model(PENDULUM[1])
    linear = hfa.linearize(model, hfa.trim(model))
    policy = _deployment(file, linear, [])
    trim = np.zeros(policy.function.numel_in(1))
    torque = float(policy.function(np.array([0.1, -0.3]), trim))
    assert torque == pytest.approx(-1.98 * 0.1 + 0.98 * 0.3)
    assert policy.timing == "sampling (0.02 s), delay (0.04 s), actuators"


@pytest.mark.slow
def test_a_deployment_file_is_proved(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """The certificate is accepted for this deployment file and refused for another gain."""
    words = options_of_deployment(tmp_path)
    proof = str(tmp_path / "proof.json")
    assert main([*words, "--seconds", "3", "-o", proof]) == 0
    title = " ".join(capsys.readouterr().out.split("\n\n")[0].split())
    left_out = "without sampling (0.02 s), delay (0.04 s), actuators, disturbances"
    assert title.endswith(f"of pendulum, {left_out}")
    assert main([*words, "--check", proof]) == 0
    assert main([*options_of_deployment(tmp_path, gain=-0.99), "--check", proof]) == 2


def test_observed_inputs_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A deployment file with an observation that depends on an input is refused."""
    assert main(options_of_deployment(tmp_path, observed="torque")) == 2
    assert "observation.torque depends on an input" in capsys.readouterr().err


def test_the_message_suggests_a_missing_activation(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The message on a missing activation suggests an entry of the file.

    The option --set cannot be used with --policy.
    """
    np.savez(tmp_path / "pi.npz", **{"0.weight": np.ones((3, 2)), "2.weight": np.ones((1, 3))})
    words = options_of_deployment(tmp_path)
    file = Path(words[-1])
    text = file.read_text(encoding="utf-8")
    file.write_text(re.sub(r'file = ".*?"', 'file = "pi.npz"', text), encoding="utf-8")
    assert main(words) == 2
    message = capsys.readouterr().err
    assert 'give activation="tanh"' in message
    assert "--set" not in message
