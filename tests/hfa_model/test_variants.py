"""The variants, compared with the equations of Gibson, Annaswamy, Lavretsky, AIAA 2011-6202."""

from __future__ import annotations

from itertools import combinations
from math import cos, sin
from typing import Any

import casadi as ca
import numpy as np
import pytest
from random_points import random_points

import hfa
import hfa_model
from hfa import Model
from hfa_model import VARIANTS, Parameters, State

#: Corrections for which the report's equations follow from first principles; `accelerations`
#: describes them.
REPAIRS = ("section moment", "hinge inertia", "pitch rate", "moving hinge")


Published, Newton = (type(VARIANTS[name]) for name in ("published", "newton"))


class GibsonsLever(Published):  # type: ignore[misc, valid-type]
    """The published variant with the lever arm of Eq. (42) and the hinge inertia of Eq. (46)."""

    outer_lever = Newton.outer_lever

    def hinge_inertia(self, dihedral: Any, p: Parameters) -> Any:
        """Return I_xx + m s²/4 + (m s²/6) cos² η, slug ft^2, with the roll inertia I_xx of a
        panel."""
        return p.inertia_roll + p.panel_mass * p.panel_span**2 * (1 / 4 + ca.cos(dihedral) ** 2 / 6)


def accelerations(
    x: State, found: State, loads: Any, p: Parameters, repairs: tuple[str, ...]
) -> tuple[float, float]:
    """Return q' and η'' of Eqs. (42) and (44) to (46).

    found: rates, of which V' and α' are used
    loads: loads on the panels
    repairs: corrections of the printed equations:
        section moment: M_i of an outer panel turns with the panel. Eq. (42) does not state its
        frame.
        hinge inertia: the term in cos² η of Eq. (46) has the sign of Eq. (70).
        pitch rate: the term V cos α q in d2 has the sign of Eq. (30).
        moving hinge: M_j = dH_j/dt + v_j × ρ with ρ = m v_c, where Eq. (10) has dH_j/dt alone.

    The printed H of Eq. (44) lacks its lever arm s/2, which is added here.
    """
    m = p.panel_mass
    s = p.panel_span
    eta = x.dihedral
    spin = x.dihedral_rate
    center = loads.center
    outer = loads.outer
    moment = center.moment + 2 * outer.moment * (cos(eta) if "section moment" in repairs else 1.0)
    moment += p.boom_length * (center.tail_downward + 2 * outer.tail_downward * cos(eta))
    moment += s / 3 * sin(eta) * center.forward + 2 * (-s / 6 * sin(eta)) * outer.forward
    c1 = 3 * p.inertia_pitch
    c2 = 2 * p.inertia_yaw - 2 * p.inertia_pitch + m * s**2 / 6
    pitch = (moment - 2 * c2 * sin(eta) * cos(eta) * spin * x.pitch_rate) / (
        c1 + c2 * sin(eta) ** 2
    )

    hinge = -s / 2 * outer.downward - s / 2 * m * p.gravity * cos(eta) * cos(x.pitch)
    descent = found.speed * sin(x.alpha) + x.speed * cos(x.alpha) * found.alpha
    d1 = (
        descent * cos(eta)
        - x.speed * sin(x.alpha) * sin(eta) * spin
        - 2 * s / 3 * cos(eta) * sin(eta) * spin**2
    )
    d2 = (p.inertia_pitch - p.inertia_yaw - m * s**2 / 12) * sin(eta) * cos(eta) * x.pitch_rate**2
    d2 += (
        (1 if "pitch rate" in repairs else -1)
        * m
        * s
        / 2
        * cos(eta)
        * x.speed
        * cos(x.alpha)
        * x.pitch_rate
    )
    d3 = p.inertia_roll + m * (
        s**2 / 4 + (-1 if "hinge inertia" in repairs else 1) * s**2 / 6 * cos(eta) ** 2
    )
    forward = x.speed * cos(x.alpha)
    hinge_descent = x.speed * sin(x.alpha) + s / 3 * cos(eta) * spin
    across = hinge_descent * sin(eta), hinge_descent * cos(eta)
    v_j = forward + s / 3 * sin(eta) * x.pitch_rate, *across  # Eq. (67)
    v_c = forward - s / 6 * sin(eta) * x.pitch_rate, across[0], across[1] - s / 2 * spin  # Eq. (69)
    carried = m * np.cross(v_j, v_c)[0] if "moving hinge" in repairs else 0.0
    elastic = -p.hinge_damping * spin - p.hinge_stiffness * eta
    return pitch, (hinge + elastic + m * s / 2 * d1 - d2 - carried) / d3


def worst(aircraft: Model, repairs: tuple[str, ...]) -> float:
    """Return the largest relative difference of q' and η'' between the aircraft and
    `accelerations`.

    100 random states and inputs are compared.
    """
    differences = []
    for state, control in zip(*random_points(100, seed=4), strict=True):
        computed = State(*aircraft.at(state, control).f)
        theirs = accelerations(
            State(*state),
            computed,
            hfa_model.loads(aircraft, state, control),
            hfa_model.parameters_of(aircraft),
            repairs,
        )
        ours = computed.pitch_rate, computed.dihedral_rate
        differences += [
            abs(ours_there - theirs_there) / (1 + abs(ours_there))
            for ours_there, theirs_there in zip(ours, theirs, strict=True)
        ]
    return max(differences)


def test_newton_equals_the_report_with_four_corrections(parameters: Parameters) -> None:
    """The rates of "newton" equal the equations of the report with four corrections."""
    assert worst(hfa.aircraft("newton", parameters), REPAIRS) < 1e-12


@pytest.mark.parametrize("repairs", [*combinations(REPAIRS, 3), ()], ids=str)
def test_each_of_the_four_corrections_is_needed(
    parameters: Parameters, repairs: tuple[str, ...]
) -> None:
    """Without one of the four corrections, the report's equations differ from "newton"."""
    assert worst(hfa.aircraft("newton", parameters), repairs) > 1e-2


def test_published_differs_from_gibson_in_two_terms(
    parameters: Parameters,
) -> None:
    """With the report's lever arm and hinge inertia, "published" equals the report's equations."""
    assert worst(hfa.aircraft(GibsonsLever(), parameters), ()) < 1e-12
    assert worst(hfa.aircraft("published", parameters), ()) > 1e-2
