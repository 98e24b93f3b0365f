"""The equations in columns: the same numbers as by name, for symbols of either kind and for mixed parameters."""

from __future__ import annotations

import casadi as ca
import numpy as np
import pytest
from random_points import random_points

from hfa_model import INPUTS, STATES, VARIANTS, Input, Parameters, State
from hfa_model.dynamics import rates, state_rates
from hfa_model.variants import Variant


@pytest.mark.parametrize("variant", VARIANTS.values(), ids=VARIANTS)
@pytest.mark.parametrize("kind", [ca.SX, ca.MX])
def test_columns_give_the_rates_by_name(parameters: Parameters, variant: Variant, kind: type) -> None:
    x, u, w = kind.sym("x", len(STATES)), kind.sym("u", len(INPUTS)), kind.sym("w")
    p = kind.sym("p", len(Parameters._fields))
    f = ca.Function("f", [x, u, p, w], [state_rates(x, u, p, variant, w)])
    for state, control in zip(*random_points(20, seed=3), strict=True):
        expected = rates(State(*state.tolist()), Input(*control.tolist()), parameters, variant, 5.0)
        found = np.array(f(state, control, np.array(parameters), 5.0)).ravel()
        np.testing.assert_allclose(found, expected, rtol=1e-13, atol=1e-13)
