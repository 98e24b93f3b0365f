"""Tables over the dihedral."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controller.design.dihedral_table import DihedralTable, interpolated, shares


def test_it_is_linear_between_the_angles_and_constant_beyond() -> None:
    rng = np.random.default_rng(0)
    angles, one, other = np.array([0.1, 0.2, 0.5]), rng.normal(size=(3, 2, 4)), rng.normal(size=(3, 3, 1))
    table, eta = DihedralTable(angles, [one, other]), ca.SX.sym("eta")
    looked_up = ca.Function("looked_up", [eta], list(table.at(eta)))
    for at in (0.0, 0.1, 0.17, 0.2, 0.4, 0.5, 0.9):
        share = shares(angles, at)
        for found, stack in zip(looked_up(at), (one, other), strict=True):
            np.testing.assert_allclose(np.array(found), np.tensordot(share, stack, 1), atol=1e-14)
    np.testing.assert_allclose(shares(angles, 0.17), [0.3, 0.7, 0.0])
    np.testing.assert_allclose(
        np.array(interpolated(angles, one[:, 0], 0.17)).ravel(), 0.3 * one[0, 0] + 0.7 * one[1, 0]
    )
