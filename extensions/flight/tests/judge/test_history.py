"""Policies that use the observations of several samples."""

import casadi as ca
import numpy as np
import pytest
from policy_cases import aircraft, gtm_deployment, trims
from scipy.signal import cont2discrete
from tolerances import FEW_ROUNDINGS

import hfa
from hfa import BadInputError, assess

#: Gain on three samples, the oldest first: a lead on the pitch rate and a gain on the pitch.
GAIN = np.zeros((2, 12))
GAIN[0, [2, 6, 10]] = [-0.1, 0.0, 0.3]
GAIN[0, 11] = 0.4
GAIN[1, [4, 8]] = [-1.0, -1.0]


def stacked(delay=0.0, history=3, gain=GAIN):
    """Return a deployment of a gain that observes several samples of the GTM's four states.

    delay: s
    history: number of samples
    gain: (2, 4 history)
    """
    o = ca.SX.sym("o", gain.shape[1])
    policy = {"file": ca.Function("gain", [o], [ca.DM(gain) @ o])}
    action = {"elevator": {"box": [-9, 9]}, "throttle": {"box": [-9, 9]}}
    return gtm_deployment(
        policy, action=action, timing={"dt": 0.02, "delay": delay, "history": history}
    )


def test_spectral_radius_includes_past_states():
    """The spectral radius equals that of the loop with state (x_k; x_{k-1}; x_{k-2}).

    The loop for comparison is built with SciPy's held plant. The reported K is the sum of the gains
    on all samples.
    """
    model, point = aircraft("ppo_gtm"), trims("ppo_gtm")[1]
    result = hfa.assess(model, stacked(), [point], samples=0)
    linear = hfa.linearize(model, point)
    Phi, Gamma, *_ = cont2discrete((linear.A, linear.B, np.eye(4), np.zeros((4, 2))), 0.02)
    oldest, older, last = np.split(GAIN, 3, axis=1)
    one, none = np.eye(4), np.zeros((4, 4))
    first = np.hstack([Phi + Gamma @ last, Gamma @ older, Gamma @ oldest])
    loop = np.vstack([first, np.hstack([one, none, none]), np.hstack([none, one, none])])
    radius = np.abs(np.linalg.eigvals(loop)).max()
    (assessed,) = result.points
    assert assessed.radius == pytest.approx(radius, rel=1e3 * FEW_ROUNDINGS)
    np.testing.assert_allclose(assessed.equilibrium.K, -(oldest + older + last), atol=1e-12)


@pytest.mark.parametrize(
    ("history", "said"),
    [
        (0, "timing.history is 0"),
        (2.5, "timing.history is 2.5; give a whole number of samples"),
        (2, "requires 12 observations, but the deployment file lists 8"),
    ],
)
def test_a_wrong_history_is_refused(history, said):
    """A history that is zero, not an integer or inconsistent with the policy is refused."""
    with pytest.raises(BadInputError, match=said):
        assess(aircraft("ppo_gtm"), stacked(history=history), [45.0], samples=0)
