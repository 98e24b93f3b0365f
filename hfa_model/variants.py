"""The two variants of the equations of motion, and the six terms in which they differ.

`published` reproduces the matrices printed in the paper. `newton` has the exact mechanics of three
rigid panels, which the Euler-Lagrange equations give, too. All six terms are in this module. The
printed matrices require each term except the η'² term, which has no effect on a linear model
(`docs/paper.md`). η is the dihedral, q the pitch rate, and s and m are the span and mass
of one panel.

| term | published | newton |
|---|---|---|
| lever of the outer panels' forward force | s/2 - (s/3) sin η | (s/6) sin η |
| outer section moments, projected on the pitch axis | 1 | cos η |
| (m s/2) cos η V cos α q in η'' | + | - |
| (m s/2) V sin α sin η η' in η'' | - | absent |
| factor on (m s/2) cos η sin η η'² in η'' | -2s/3 | -s/3 |
| cos-term of the hinge inertia | +(m s²/6) cos(η²) | -(m s²/6) cos² η |

The two terms in η' differ because `published` neglects the motion of the hinge
(`docs/trim.md`).
"""

from __future__ import annotations

from dataclasses import dataclass

import casadi as ca

from hfa_model.parameters import Parameters, Quantity, State
from hfa_support.errors import BadInputError, refuse_unknown


@dataclass(frozen=True)
class Published:
    """Equations that reproduce the printed matrices (paper Section 2.2; Gibson et al. 2011, Eqs.
    45-46)."""

    name = "published"

    def outer_lever(self, dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
        """Return the lever arm l = s/2 - (s/3) sin η of the outer panels' forward force, ft.

        dihedral: η, rad
        p: parameters, with the span s of a panel
        """
        return p.panel_span / 2 - p.panel_span / 3 * ca.sin(dihedral)

    def section_projection(self, dihedral: Quantity) -> Quantity:
        """Return 1, the factor on the section moments of the outer panels in the pitching
        moment."""
        return 1.0

    def hinge_coupling(self, x: State[Quantity], p: Parameters[Quantity]) -> Quantity:
        """Return the inertial coupling moment about a hinge, ft lbf.

        (m s/2) [cos η V cos α q - V sin α sin η η' - (2s/3) cos η sin η η'²], with the mass m and
        span s of a panel.
        """
        sin_eta = ca.sin(x.dihedral)
        cos_eta = ca.cos(x.dihedral)
        return (p.panel_mass * p.panel_span / 2) * (
            cos_eta * x.speed * ca.cos(x.alpha) * x.pitch_rate
            - x.speed * ca.sin(x.alpha) * sin_eta * x.dihedral_rate
            - 2 * p.panel_span / 3 * cos_eta * sin_eta * x.dihedral_rate**2
        )

    def hinge_inertia(self, dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
        """Return d3 = I_xx + m s²/4 + (m s²/6) cos(η²), slug ft^2.

        I_xx, m and s are the roll inertia, mass and span of a panel. The paper prints cos² η. Only
        the cosine of the squared angle reproduces the printed matrices, and the released simulation
        up to 45 deg (`docs/paper.md`).
        """
        mass_moment = p.panel_mass * p.panel_span**2
        return p.inertia_roll + mass_moment / 4 + mass_moment / 6 * ca.cos(dihedral**2)


@dataclass(frozen=True)
class Newton:
    """Exact equations of motion of three rigid bodies on two hinges, with forces by virtual
    work."""

    name = "newton"

    def outer_lever(self, dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
        """Return the lever arm l = (s/6) sin η of the outer panels' forward force, ft.

        The lever arm is the height of an outer panel above the center of mass.

        dihedral: η, rad
        p: parameters, with the span s of a panel
        """
        return p.panel_span / 6 * ca.sin(dihedral)

    def section_projection(self, dihedral: Quantity) -> Quantity:
        """Return cos η, the factor on the section moments of the outer panels in the pitching
        moment.

        The spanwise axis of an outer panel is inclined by the dihedral η to the pitch axis.
        """
        return ca.cos(dihedral)

    def hinge_coupling(self, x: State[Quantity], p: Parameters[Quantity]) -> Quantity:
        """Return the inertial coupling moment about a hinge, ft lbf.

        (m s/2) [-cos η V cos α q - (s/3) cos η sin η η'²], with the mass m and span s of a panel.
        """
        cos_eta = ca.cos(x.dihedral)
        return (p.panel_mass * p.panel_span / 2) * (
            -cos_eta * x.speed * ca.cos(x.alpha) * x.pitch_rate
            - p.panel_span / 3 * cos_eta * ca.sin(x.dihedral) * x.dihedral_rate**2
        )

    def hinge_inertia(self, dihedral: Quantity, p: Parameters[Quantity]) -> Quantity:
        """Return d3 = I_xx + m s²/4 - (m s²/6) cos² η, slug ft^2.

        I_xx, m and s are the roll inertia, mass and span of a panel. The negative term is due to
        the motion of the center of mass when the panel rotates.
        """
        mass_moment = p.panel_mass * p.panel_span**2
        return p.inertia_roll + mass_moment / 4 - mass_moment / 6 * ca.cos(dihedral) ** 2


Variant = Published | Newton

#: Variants that the user can choose by name.
VARIANTS: dict[str, Variant] = {"published": Published(), "newton": Newton()}
#: Dynamics that the user can choose by name: the variants, and those of `hfa_model.unsteady`, which
#: have more than seven states.
DYNAMICS = (*VARIANTS, "unsteady")


def variant_named(name: str) -> Variant:
    """Return the variant of the equations of motion with a name in `VARIANTS`.

    Raises BadInputError for any other name.
    """
    if name in VARIANTS:
        return VARIANTS[name]
    refuse_unknown("unknown dynamics", name, DYNAMICS)
    raise BadInputError(
        f"the {name} dynamics have more than seven states; use {' or '.join(VARIANTS)}"
    )
