"""Commands of the core run with `--dynamics unsteady`."""

import numpy as np
from cli import answer

from hfa_model import STATES, UNSTEADY

LAG_STATES = tuple(UNSTEADY.states)[len(STATES) :]
UNSTEADY_11 = ("--dihedral", "11", "--dynamics", "unsteady")


def test_trims_and_models_contain_the_lag_states():
    """Trims with unsteady dynamics contain all lag states.

    Linear models omit the lag states of gusts and E, unless `--states` lists these states.
    """
    trimmed = answer("trim", *UNSTEADY_11)["operating_point"]
    assert list(trimmed["states"])[len(STATES) :] == list(LAG_STATES)
    model = answer("linearize", *UNSTEADY_11)
    assert model["states"] == list(UNSTEADY.linear)
    assert "E" not in model
    gusts = [name for name in LAG_STATES if name not in UNSTEADY.linear]
    states = [*UNSTEADY.linear, *gusts]
    windy = answer("linearize", *UNSTEADY_11, "--states", ",".join(states))
    assert np.array(windy["E"]).shape == (len(states), len(UNSTEADY.disturbances))
