"""Tables over the dihedral."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controller.policy.servo_policy import DihedralTable
from hfa_support.linear_table import LinearTable


def test_it_is_linear_between_the_angles_and_constant_beyond() -> None:
    rng = np.random.default_rng(0)
    angles, one, other = np.array([0.1, 0.2, 0.5]), rng.normal(size=(3, 2, 4)), rng.normal(size=(3, 3, 1))
    table, eta = DihedralTable(angles, [one, other]), ca.SX.sym("eta")
    looked_up = ca.Function("looked_up", [eta], list(table.at(eta)))
    for at in (0.0, 0.1, 0.17, 0.2, 0.4, 0.5, 0.9):
        for found, stack in zip(looked_up(at), (one, other), strict=True):
            expected = [np.interp(at, angles, column) for column in stack.reshape(3, -1).T]
            np.testing.assert_allclose(np.array(found).ravel(), expected, atol=1e-14)
            np.testing.assert_allclose(LinearTable(angles, stack).at(at).ravel(), expected, atol=1e-14)
