"""`unsteady`: the mechanics of `newton` with the air loads that the report of 2011 leaves out
(`docs/validity.md`).

Each effect has a parameter, 1 as it should be and 0 without it; without any the rates are those of
`newton`.

| parameter | effect | |---|---| | `local_motion` | wing and tail take the flow at their own
three-quarter chord, each part of an outer wing its own η' | | `apparent_mass` | air moves with
wings and tails: π ρ b² per length, with its moments (Theodorsen, NACA 496) | | `lift_lag` | lift
follows motion, ailerons and elevators with Wagner's function (R. T. Jones, NACA 681) | | `gust_lag`
| lift follows air that rises or moves outward with Küssner's function; a headwind acts at once | |
`finite_span` | lift slope a / (1 + a / (π Λ)): Λ of the whole wing (span 3 s), of a tail
`tail_aspect_ratio` | | `downwash_share` | 2 C_L / (π Λ) at the tails, C_L the mean of the wings,
later by l_b / V (first order) |

At 1 the downwash is that of the far wake; a lifting line has 1.71 times that at the center tail,
1.52 at the others. The lags are those of two dimensions; in steady flight nothing lags, and a trim
is that of quasi-steady loads. The density of the air counts as constant along the path. Nothing
here was fitted: all other parameters are those of `newton`, the drag polar too. Panels stay rigid,
motion longitudinal; a gust meets wing and tail of a panel at once."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Any, NamedTuple

import casadi as ca

from hfa_aircraft.signals import Signal
from hfa_model.aerodynamics import Loads, PanelLoads, panel_loads, sum_of_panels
from hfa_model.atmosphere import density
from hfa_model.declaration import rigid_panels
from hfa_model.dynamics import rates_from_loads
from hfa_model.kinematics import (
    Velocity,
    Winds,
    airspeed,
    center_height,
    center_velocity,
    flow_of,
    outer_height,
    outer_velocity,
    winds_named,
)
from hfa_model.outputs import Moment, outputs_of
from hfa_model.parameters import default_parameters
from hfa_model.variants import Newton, variant_named
from hfa_model.vectors import LINEAR_STATES, STATE_SIGNALS, STATES, Quantity

NEWTON = Newton()


class Lag(NamedTuple):
    """1 - Σ A_i exp(-b_i s) of a unit step, s = V t / b in half chords b."""

    shares: tuple[float, float]
    rates: tuple[float, float]


#: Approximations of Wagner's function (R. T. Jones, NACA 681, 1940) and of Küssner's (Bisplinghoff,
#: Ashley, Halfman, Aeroelasticity, Eq. 5-383).
WAGNER = Lag((0.165, 0.335), (0.0455, 0.3))
KUESSNER = Lag((0.5, 0.5), (0.13, 1.0))
#: The strips; `tip` is how the angle of attack varies along an outer wing, at its tip.
STRIPS = ("center", "outer", "tip", "tail_center", "tail_outer")
_LAGS = tuple(f"lag_{strip}_{i}" for strip in STRIPS for i in (1, 2))
_GUSTS = tuple(f"gust_{strip}_{i}" for strip in STRIPS if strip != "tip" for i in (1, 2))
#: States beside the seven: angles that follow those of a strip's motion and control, of its gust,
#: and the downwash.
LAG_STATES = (*_LAGS, *_GUSTS, "downwash")
EFFECTS = ("local_motion", "apparent_mass", "lift_lag", "gust_lag", "finite_span", "downwash_share")


class _Flown(NamedTuple):
    """What one panel feels: its loads, the lift coefficient of its wing, and the rates of its lag
    states."""

    loads: PanelLoads[Quantity]
    lift_coefficient: Quantity
    rates: dict[str, Quantity]


class _Plate(NamedTuple):
    """A wing or a tail: apparent mass, slug, half chord and span, ft, and how far its mid-chord
    lies behind the quarter chord of the wing, ft."""

    mass: Quantity
    half_chord: Quantity
    span: Quantity
    aft: Quantity


@dataclass(frozen=True)
class UnsteadyEquations:
    """As a `Model` takes them. ground_drag: as in `aircraft.Equations`."""

    ground_drag: bool = False

    def __call__(
        self, x: Any, u: Any, p: Any, w: Any
    ) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
        """Rates by state, outputs by name."""
        winds = winds_named(w._fields, w, ground_drag=self.ground_drag)
        # Air that rises or moves outward is a gust; the air from ahead is part of the motion.
        calm = [each._replace(updraft=0.0, outward=0.0) for each in (winds.center, winds.outer)]
        still = Winds(calm[0], calm[1])
        air = density(x.altitude)
        motion = (center_velocity(x, p, still), outer_velocity(x, p, still))
        center = _flown("center", motion[0], center_velocity(x, p, winds), x, u, p, winds, air)
        outer = _flown("outer", motion[1], outer_velocity(x, p, winds), x, u, p, winds, air)
        loads = sum_of_panels(x, u, center.loads, outer.loads, p, NEWTON)
        tip, tip_rates = _tip_moment(x, p, flow_of(*motion[1]).speed, air)
        loads = loads._replace(hinge_moment=loads.hinge_moment + tip)
        loads = _with_apparent_mass(x, loads, motion, still, p, air)
        rates = rates_from_loads(x, loads, p, NEWTON)
        lift = (center.lift_coefficient + 2 * outer.lift_coefficient) / 3
        downwash = x.speed / p.boom_length * (2 * lift / (math.pi * _aspect_ratio(p)) - x.downwash)
        lags = {**center.rates, **outer.rates, **tip_rates, "downwash": downwash}
        return {**rates._asdict(), **lags}, outputs_of(Moment(x, u, p, winds, loads, rates))


def _aspect_ratio(p: Any) -> Quantity:
    return 3 * p.panel_span / p.chord


def _slope_factor(p: Any, aspect_ratio: Quantity) -> Quantity:
    """1 / (1 + a / (π Λ)) (Prandtl, elliptic lift)."""
    return 1 / (1 + p.finite_span * p.lift_slope / (math.pi * aspect_ratio))


def _tail_chord(p: Any) -> Quantity:
    return ca.sqrt(p.tail_area / p.tail_aspect_ratio)


def _turn(panel: str, x: Any) -> Quantity:
    """The pitch rate about the spanwise axis of a panel, rad/s."""
    return x.pitch_rate if panel == "center" else x.pitch_rate * ca.cos(x.dihedral)


def missing(kind: str, strip: str, lag: Lag, angle: Quantity, x: Any) -> Quantity:
    """Σ A_i (a - z_i): what of a strip's angle has not yet become lift, rad."""
    pairs = zip(lag.shares, (1, 2), strict=True)
    return sum(share * (angle - getattr(x, f"{kind}_{strip}_{i}")) for share, i in pairs)


def lag_rates(
    kind: str, strip: str, lag: Lag, angle: Quantity, x: Any, half_chords: Quantity
) -> dict[str, Quantity]:
    """z_i' = b_i (V/b) (a - z_i); half_chords: V/b, 1/s."""
    names = [f"{kind}_{strip}_{i}" for i in (1, 2)]
    return {
        name: rate * half_chords * (angle - getattr(x, name))
        for name, rate in zip(names, lag.rates, strict=True)
    }


def _flown(
    panel: str,
    motion: Velocity,
    moving: Velocity,
    x: Any,
    u: Any,
    p: Any,
    winds: Winds,
    air: Quantity,
) -> _Flown:
    """A panel that moves through still air, and through the moving air, with these velocities.

    The angle of attack of a strip, less what lags, turns its lift too: what the wake induces is a
    flow."""
    aileron = getattr(u, f"aileron_{panel}")
    elevator = getattr(u, f"elevator_{panel}")
    rates: dict[str, Quantity] = {}

    def effective(
        strip: str, control: Quantity, behind: Quantity, downwash: Quantity, chord: Quantity
    ) -> Quantity:
        moved = p.local_motion * _turn(panel, x) * behind
        angle = ca.atan2(motion[2] + moved, motion[0]) - downwash
        gust = ca.atan2(moving[2] + moved, moving[0]) - downwash - angle
        half_chords = 2 * flow_of(*moving).speed / chord
        rates.update(lag_rates("lag", strip, WAGNER, angle + control, x, half_chords))
        rates.update(lag_rates("gust", strip, KUESSNER, gust, x, half_chords))
        lagging = p.lift_lag * missing("lag", strip, WAGNER, angle + control, x)
        return angle + gust - lagging - p.gust_lag * missing("gust", strip, KUESSNER, gust, x)

    wind = getattr(winds, panel)
    flow = flow_of(*moving)
    tail_chord = _tail_chord(p)
    speed = x.speed if winds.ground_drag else airspeed(x, wind)
    factor = _slope_factor(p, _aspect_ratio(p))
    tail_factor = _slope_factor(p, p.tail_aspect_ratio)
    alpha = effective(panel, p.aileron_lift / p.lift_slope * aileron, p.chord / 2, 0.0, p.chord)
    behind = p.boom_length + tail_chord / 2
    tail_alpha = effective(
        f"tail_{panel}", elevator, behind, p.downwash_share * x.downwash, tail_chord
    )
    of_wing = p._replace(
        lift_slope=factor * p.lift_slope, aileron_lift=factor * p.aileron_lift, tail_area=0.0
    )
    of_tail = p._replace(lift_slope=tail_factor * p.lift_slope, chord=0.0)
    wing = panel_loads(flow._replace(alpha=alpha), speed, aileron, 0.0, air, of_wing)
    tail = panel_loads(flow._replace(alpha=tail_alpha), speed, 0.0, elevator, air, of_tail)
    loads = PanelLoads(*(one + other for one, other in zip(wing, tail, strict=True)))
    return _Flown(loads, of_wing.lift_slope * alpha + of_wing.aileron_lift * aileron, rates)


def _tip_moment(
    x: Any, p: Any, speed: Quantity, air: Quantity
) -> tuple[Quantity, dict[str, Quantity]]:
    """H = ½ρV² c a (s²/6) a_tip, a_tip = -η' s / (2V): the wing's lift varies along an outer panel
    as η' does there; ft lbf. And the rates of its lag states."""
    angle = -p.local_motion * x.dihedral_rate * p.panel_span / (2 * speed)
    tip = angle - p.lift_lag * missing("lag", "tip", WAGNER, angle, x)
    slope = _slope_factor(p, _aspect_ratio(p)) * p.lift_slope
    moment = air * speed**2 / 2 * p.chord * slope * p.panel_span**2 / 6 * tip
    return moment, lag_rates("lag", "tip", WAGNER, angle, x, 2 * speed / p.chord)


def _with_apparent_mass(
    x: Any,
    loads: Loads[Quantity],
    motion: tuple[Velocity, Velocity],
    still: Winds,
    p: Any,
    air: Quantity,
) -> Loads[Quantity]:
    """The loads with those of the air that wings and tails carry with them.

    A plate of half chord b that turns by ω about its span has the normal velocity w at its
    mid-chord and the momentum m w across it, m = π ρ b² span, and the angular momenta (m b²/8) ω
    about its span, (m span²/12) η' about its chord. The force is -(m w n)': -m w' across the plate,
    -m w ω forward, m w η' toward the center. The moment of the lift, which acts at the quarter
    chord, lacks -m u (b/2) ω (Theodorsen's 3/4-chord force). The accelerations (w_b', q', η''), w_b
    = V sin α, solve (M + M_a) a = M a_0, with a_0 of all other loads."""
    sin_eta, cos_eta, sin_alpha, cos_alpha = (
        f(a) for a in (x.dihedral, x.alpha) for f in (ca.sin, ca.cos)
    )
    hinge_rate = x.dihedral_rate
    third = p.panel_span / 3
    X: Quantity = 0.0
    Z: Quantity = 0.0
    pitching = loads.pitching_moment
    hinge = loads.hinge_moment
    mass: Any = ca.DM(3, 3)
    heights = center_height(x.dihedral, p), outer_height(x.dihedral, p)
    for number, (panel, count) in enumerate((("center", 1), ("outer", 2))):
        (u, _, w), turn, wind = motion[number], _turn(panel, x), (still.center, still.outer)[number]
        center = panel == "center"
        lean, bend = (1.0, 0.0) if center else (cos_eta, sin_eta)
        # w' = t . (w_b', q', η'') + what follows from the velocities.
        descent = (
            third * sin_eta * -(hinge_rate**2) + wind.headwind * ca.cos(x.pitch) * x.pitch_rate
        )
        hinge_descent = (
            x.speed * sin_alpha + third * cos_eta * hinge_rate + wind.headwind * ca.sin(x.pitch)
        )
        by_hinge = third * cos_eta * lean - (0.0 if center else p.panel_span / 2)
        for plate in _plates(p, air):
            speed = w + turn * plate.aft
            drift = lean * descent - bend * hinge_rate * (hinge_descent + plate.aft * x.pitch_rate)
            along = -plate.mass * speed * turn
            across = -plate.mass * drift
            inward = plate.mass * speed * hinge_rate
            down = across * lean + inward * bend
            roll = plate.mass * plate.span**2 / 12
            spin = plate.mass * plate.half_chord**2 / 8
            X = X + count * along
            Z = Z + count * down
            moment = (
                plate.aft * down
                + heights[number] * along
                - lean * plate.mass * u * plate.half_chord / 2 * turn
            )
            pitching += count * (moment + 2 * spin * lean * bend * x.pitch_rate * hinge_rate)
            if not center:
                hinge -= p.panel_span / 2 * across + spin * lean * bend * x.pitch_rate**2
            t = ca.vertcat(lean, plate.aft * lean, by_hinge)
            turned = ca.vertcat(0.0, spin * lean**2, 0.0 if center else roll)
            mass += count * (ca.diag(turned) + plate.mass * t @ t.T)

    def added(X: Quantity, Z: Quantity, pitching: Quantity, hinge: Quantity) -> Loads[Quantity]:
        lift = X * sin_alpha - Z * cos_alpha
        drag = -(X * cos_alpha + Z * sin_alpha)
        return loads._replace(
            lift=loads.lift + lift,
            drag=loads.drag + drag,
            pitching_moment=pitching,
            hinge_moment=hinge,
        )

    base = rates_from_loads(x, added(X, Z, pitching, hinge), p, NEWTON)
    descent_rate = base.speed * sin_alpha + x.speed * cos_alpha * base.alpha
    first = ca.vertcat(descent_rate, base.pitch_rate, base.dihedral_rate)
    c2 = 2 * p.inertia_yaw - 2 * p.inertia_pitch + p.panel_mass * p.panel_span**2 / 6
    hinge_inertia = 2 * NEWTON.hinge_inertia(x.dihedral, p)
    own = ca.diag(
        ca.vertcat(3 * p.panel_mass, 3 * p.inertia_pitch + c2 * sin_eta**2, hinge_inertia)
    )
    # Both matrices are symmetric, their sum positive definite: L D L' keeps the digits that a
    # symbolic QR loses.
    forces = mass @ (first - ca.ldl_solve(mass @ first, *ca.ldl(own + mass)))
    by_the_hinge = (forces[2] - third * cos_eta * forces[0]) / 2
    return added(X, Z - forces[0], pitching - forces[1], hinge - by_the_hinge)


def _plates(p: Any, air: Quantity) -> tuple[_Plate, _Plate]:
    """The wing and the tail of a panel."""
    chord = _tail_chord(p)
    mass = [
        p.apparent_mass * math.pi * air * area / 4
        for area in (p.chord**2 * p.panel_span, p.tail_area * chord)
    ]
    return (
        _Plate(mass[0], p.chord / 2, p.panel_span, p.chord / 4),
        _Plate(mass[1], chord / 2, p.tail_area / chord, p.boom_length + chord / 4),
    )


#: The aircraft without lags.
_RIGID = rigid_panels(variant_named("published"), default_parameters().values)


def _signals() -> dict[str, Signal]:
    values = default_parameters().values._asdict()
    own = {
        name: each._replace(start=float(values[name])) for name, each in _RIGID.parameters.items()
    }
    effects = {name: Signal("1", 1.0, 0.0, 2.0, start=1.0) for name in EFFECTS}
    # The parameters do not say how the area of a tail is spread: 20 ft by 2 ft are assumed.
    return {**own, **effects, "tail_aspect_ratio": Signal("1", 10.0, 0.1, 1000.0, start=10.0)}


#: The aircraft with its identified parameters and all effects.
UNSTEADY = replace(
    _RIGID,
    name="unsteady",
    called="unsteady dynamics",
    states={**STATE_SIGNALS._asdict(), **dict.fromkeys(LAG_STATES, Signal("rad", 0.1))},
    equations=UnsteadyEquations(),
    parameters=_signals(),
    steady=tuple(name for name in (*STATES, *LAG_STATES) if name != "altitude"),
    # Wind alone moves the states of gusts: no input reaches them, and a game cannot learn them.
    linear=(*LINEAR_STATES, *_LAGS, "downwash"),
    modes={**_RIGID.modes, "lag": (*_LAGS, "downwash"), "gust": _GUSTS},
    parts={"short_period": ("alpha", *_LAGS, "downwash")},
)
