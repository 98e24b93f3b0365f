"""Commands of the core run with `--dynamics unsteady`."""

from __future__ import annotations

import numpy as np
from cli import answer

from hfa_model import LINEAR_STATES, STATES, UNSTEADY

LAG_STATES = tuple(UNSTEADY.states)[len(STATES) :]
UNSTEADY_11 = ("--dihedral", "11", "--dynamics", "unsteady")


def test_trims_and_models_contain_the_lag_states() -> None:
    """Trims with unsteady dynamics contain all lag states.

    Linear models omit the lag states of gusts, unless `--states` lists them.
    """
    trimmed = answer("trim", *UNSTEADY_11)["operating_point"]
    assert list(trimmed["states"])[7:] == list(LAG_STATES)
    model = answer("linearize", *UNSTEADY_11)
    assert model["states"] == list(UNSTEADY.linear)
    assert "E" not in model
    gusts = [name for name in LAG_STATES if name not in UNSTEADY.linear]
    windy = answer("linearize", *UNSTEADY_11, "--states", ",".join([*UNSTEADY.linear, *gusts]))
    assert np.array(windy["E"]).shape == (25, len(UNSTEADY.disturbances))


def test_unsteady_effects_can_be_set_and_swept() -> None:
    """With all effects at 0 the linear model is that of `newton`. Sweeps vary the effects."""
    off = [
        word
        for name in ("local_motion", "apparent_mass", "lift_lag")
        for word in ("--hold", f"{name}=0")
    ]
    off += [
        word
        for name in ("gust_lag", "finite_span", "downwash_share")
        for word in ("--hold", f"{name}=0")
    ]
    plain = answer("linearize", *UNSTEADY_11, *off, "--states", ",".join(LINEAR_STATES))
    newton = answer("linearize", "--dihedral", "11", "--dynamics", "newton")
    np.testing.assert_allclose(plain["A"], newton["A"], rtol=1e-9, atol=1e-10)
    data = answer(
        "sweep", "--dihedral", "20", "--dynamics", "unsteady", "--hold", "apparent_mass=0,1"
    )
    assert data["reasons"] == [""] * 2
    for share, A in zip("01", data["A"], strict=True):
        held = ("--hold", f"apparent_mass={share}")
        single = answer("linearize", "--dihedral", "20", "--dynamics", "unsteady", *held)
        np.testing.assert_allclose(A, single["A"], rtol=1e-9, atol=1e-9)
    assert np.abs(np.subtract(*data["A"])).max() > 0.1
