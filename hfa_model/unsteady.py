"""The `unsteady` dynamics: the mechanics of `newton` with unsteady and finite-span air loads.

The report of 2011 omits these loads. `docs/trim.md` describes them. Each effect has a
parameter: 1 is the full effect, and 0 switches it off. With all effects at 0, the rates equal
those of `newton`.

- `local_motion`: the angle of attack of each wing and tail is that at its three-quarter chord. The
  hinge rate η' varies the angle of attack linearly over the span of an outer wing.
- `apparent_mass`: wings and tails accelerate the air around them, π ρ b² per length, with its
  moments (Theodorsen, NACA 496).
- `lift_lag`: the lift follows motion, ailerons and elevators with Wagner's function (R. T. Jones,
  NACA 681). A headwind counts as motion.
- `gust_lag`: the lift follows vertical and outward gusts with Küssner's function.
- `finite_span`: the lift slope is a / (1 + a / (π Λ)). The aspect ratio Λ is that of the complete
  wing (span 3 s), or `tail_aspect_ratio` for a tail.
- `downwash_share`: the downwash at the tails is 2 C_L / (π Λ), with C_L the mean of the wings,
  delayed by l_b / V (first order).

At 1, the downwash is that of the far wake. A lifting line gives 1.71 times that value at the center
tail and 1.52 times at the others. The lags are those of two-dimensional flow. In steady flight
all lags vanish, so a trim equals the trim with quasi-steady loads.

Assumptions: the density of the air is constant along the path. Panels are rigid and the motion is
longitudinal. A gust reaches the wing and tail of a panel at the same time. No parameter of this
module was fitted to data. All other parameters, including the drag polar, are those of `newton`.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import replace
from typing import Any, NamedTuple

import casadi as ca

from hfa_aircraft.model import Model
from hfa_aircraft.signals import Signal
from hfa_model.aerodynamics import Loads, PanelLoads, panel_loads, sum_of_panels
from hfa_model.atmosphere import density
from hfa_model.declaration import hfa_about, rigid_panels
from hfa_model.dynamics import rates_from_loads
from hfa_model.kinematics import (
    Velocity,
    Wind,
    Winds,
    airspeed,
    center_height,
    center_velocity,
    flow_of,
    outer_height,
    outer_velocity,
    winds_of,
)
from hfa_model.outputs import Instant, outputs_of
from hfa_model.parameters import Parameters, default_parameters
from hfa_model.variants import Newton, variant_named
from hfa_model.vectors import LINEAR_STATES, STATE_SIGNALS, STATES, Quantity

NEWTON = Newton()


class Lag(NamedTuple):
    """Step response of the lift, 1 - Σ A_i exp(-b_i s).

    s = V t / b is the distance traveled in half chords b after a unit step at t = 0.

    shares: A_1, A_2
    rates: b_1, b_2
    """

    shares: tuple[float, float]
    rates: tuple[float, float]


#: Approximations of Wagner's function (R. T. Jones, NACA 681, 1940) and of Küssner's (Bisplinghoff,
#: Ashley, Halfman, Aeroelasticity, Eq. 5-383).
WAGNER = Lag((0.165, 0.335), (0.0455, 0.3))
KUESSNER = Lag((0.5, 0.5), (0.13, 1.0))
#: The strips. `tip` is the linear variation of the angle of attack over an outer wing, given at its
#: tip.
STRIPS = ("center", "outer", "tip", "tail_center", "tail_outer")
_LAGS = tuple(f"lag_{strip}_{i}" for strip in STRIPS for i in (1, 2))
_GUSTS = tuple(f"gust_{strip}_{i}" for strip in STRIPS if strip != "tip" for i in (1, 2))
#: States in addition to the seven of `newton`: lagged angles of each strip due to motion and
#: control, lagged angles due to gusts, and the downwash.
LAG_STATES = (*_LAGS, *_GUSTS, "downwash")
EFFECTS = ("local_motion", "apparent_mass", "lift_lag", "gust_lag", "finite_span", "downwash_share")


class _PanelMotion(NamedTuple):
    """Motion of a panel relative to the air around it."""

    panel: str  # "center" or "outer"
    wind: Wind  # wind at the panel
    # velocity relative to the air, ft/s, with the headwind but without updraft and outward gust
    calm: Velocity
    gusty: Velocity  # velocity relative to the air, ft/s, with all gusts
    spanwise_rate: Quantity  # pitch rate about the spanwise axis of the panel, rad/s


class _Strip(NamedTuple):
    """Wing or tail of a panel."""

    name: str  # "center" or "outer" for the wing, "tail_center" or "tail_outer" for the tail
    control: Quantity  # change of the angle of attack equivalent to the control deflection, rad
    # distance from the wing's quarter chord back to the strip's three-quarter chord, ft
    behind: Quantity
    downwash: Quantity  # downwash angle, rad
    chord: Quantity  # chord of the wing or tail, ft


class _LaggedPanel(NamedTuple):
    """Loads on one panel with lagged lift, and the rates of the panel's lag states."""

    loads: PanelLoads[Quantity]  # sum of the loads on wing and tail
    lift_coefficient: Quantity  # lift coefficient of the wing
    rates: dict[str, Quantity]  # name of a lag state -> rate, rad/s


class _Plate(NamedTuple):
    """Wing or tail as a plate that accelerates the air around it."""

    mass: Quantity  # apparent mass, slug
    half_chord: Quantity  # half of the chord, ft
    span: Quantity  # span of the plate, ft
    aft: Quantity  # distance from the wing's quarter chord back to the plate's mid-chord, ft


class _CarriedAir(NamedTuple):
    """Loads of the air accelerated by a plate."""

    # The loads are those at zero acceleration minus M_a a. The accelerations are a = (w_b', q',
    # η''), with w_b = V sin α.

    forward: Quantity  # force along the x axis of the body at zero acceleration, lbf
    downward: Quantity  # force along the z axis of the body at zero acceleration, lbf
    pitching_moment: Quantity  # pitching moment at zero acceleration, ft lbf
    hinge_moment: Quantity  # hinge moment of one outer panel at zero acceleration, ft lbf
    mass: Any  # M_a, (3, 3)


def unsteady_equations(
    x: Any, u: Any, p: Any, w: Any
) -> tuple[Mapping[str, Any], Mapping[str, Any]]:
    """Return the rates of the states and the outputs of the `unsteady` dynamics, name -> value.

    x: the states of `newton`, then `LAG_STATES`
    u: inputs
    p: the parameters of `newton`, `EFFECTS` and `tail_aspect_ratio`
    w: disturbances, a subset of `DISTURBANCES`
    """
    winds = winds_of(w)
    air = density(x.altitude)
    center_motion = _panel_motion("center", x, p, winds)
    outer_motion = _panel_motion("outer", x, p, winds)
    center = _lagged_panel(center_motion, x, u, p, air)
    outer = _lagged_panel(outer_motion, x, u, p, air)
    of_panels = sum_of_panels(x, u, center.loads, outer.loads, p, NEWTON)
    tip_moment, tip_rates = _tip_moment(x, p, flow_of(*outer_motion.calm).speed, air)
    of_flow = of_panels._replace(hinge_moment=of_panels.hinge_moment + tip_moment)
    loads = _with_apparent_mass(x, of_flow, (center_motion, outer_motion), p, air)
    rates = rates_from_loads(x, loads, p, NEWTON)
    lift_coefficient = (center.lift_coefficient + 2 * outer.lift_coefficient) / 3
    downwash = 2 * lift_coefficient / (math.pi * _aspect_ratio(p))
    downwash_rate = x.speed / p.boom_length * (downwash - x.downwash)
    lag_state_rates = {**center.rates, **outer.rates, **tip_rates, "downwash": downwash_rate}
    outputs = outputs_of(Instant(x, u, p, winds, loads, rates))
    # The reaction of the apparent mass to accelerations is inertia, not lift.
    outputs["lift"] = of_flow.lift
    outputs["pitching_moment"] = of_flow.pitching_moment
    return {**rates._asdict(), **lag_state_rates}, outputs


def _panel_motion(panel: str, x: Any, p: Any, winds: Winds) -> _PanelMotion:
    """Return the motion of a panel relative to the air."""
    # Vertical and outward air motion is a gust. Air from ahead counts as motion of the panel.
    calm = Winds(
        winds.center._replace(updraft=0.0, outward=0.0),
        winds.outer._replace(updraft=0.0, outward=0.0),
    )
    if panel == "center":
        return _PanelMotion(
            panel=panel,
            wind=winds.center,
            calm=center_velocity(x, p, calm),
            gusty=center_velocity(x, p, winds),
            spanwise_rate=x.pitch_rate,
        )
    return _PanelMotion(
        panel=panel,
        wind=winds.outer,
        calm=outer_velocity(x, p, calm),
        gusty=outer_velocity(x, p, winds),
        spanwise_rate=x.pitch_rate * ca.cos(x.dihedral),
    )


def _aspect_ratio(p: Any) -> Quantity:
    """Return the aspect ratio Λ = 3 s / c of the complete wing, with panel span s and chord c."""
    return 3 * p.panel_span / p.chord


def _slope_factor(p: Any, aspect_ratio: Quantity) -> Quantity:
    """Return 1 / (1 + f a / (π Λ)), the factor of a finite span on the lift slope a."""
    # f is the parameter `finite_span`. Source: Prandtl, for elliptic lift.
    return 1 / (1 + p.finite_span * p.lift_slope / (math.pi * aspect_ratio))


def _tail_chord(p: Any) -> Quantity:
    """Return the chord of the tail, sqrt(S_t / Λ_t), ft, from its area and aspect ratio."""
    return ca.sqrt(p.tail_area / p.tail_aspect_ratio)


def missing(kind: str, strip: str, lag: Lag, angle: Quantity, x: Any) -> Quantity:
    """Return the part of an angle of attack that has no effect on the lift yet, rad.

    The part is Σ A_i (a - z_i).

    kind: "lag" for motion and controls, "gust" for gusts
    strip: one of `STRIPS`
    lag: coefficients A_i and b_i of the step response
    angle: angle of attack a of the strip, rad
    x: states, with the lag states z_i
    """
    pairs = zip(lag.shares, (1, 2), strict=True)
    return sum(share * (angle - getattr(x, f"{kind}_{strip}_{i}")) for share, i in pairs)


def lag_rates(
    kind: str, strip: str, lag: Lag, angle: Quantity, x: Any, half_chords: Quantity
) -> dict[str, Quantity]:
    """Return name of a lag state z_i -> rate z_i' = b_i (V/b) (a - z_i), rad/s.

    The first five arguments are those of `missing`.

    half_chords: V/b, airspeed in half chords b per second, 1/s
    """
    names = [f"{kind}_{strip}_{i}" for i in (1, 2)]
    return {
        name: rate * half_chords * (angle - getattr(x, name))
        for name, rate in zip(names, lag.rates, strict=True)
    }


def _lagged_panel(motion: _PanelMotion, x: Any, u: Any, p: Any, air: Quantity) -> _LaggedPanel:
    """Return the loads on a panel with lagged lift, and the rates of the panel's lag states."""
    # The lift lags behind motion, controls and gusts. The lift is perpendicular to the flow at the
    # lagged angle of attack, because the induced velocity of the wake is part of the flow.
    aileron = getattr(u, f"aileron_{motion.panel}")
    elevator = getattr(u, f"elevator_{motion.panel}")
    tail_chord = _tail_chord(p)
    wing_strip = _Strip(
        name=motion.panel,
        control=p.aileron_lift / p.lift_slope * aileron,
        behind=p.chord / 2,
        downwash=0.0,
        chord=p.chord,
    )
    tail_strip = _Strip(
        name=f"tail_{motion.panel}",
        control=elevator,
        behind=p.boom_length + tail_chord / 2,
        downwash=p.downwash_share * x.downwash,
        chord=tail_chord,
    )
    wing_alpha, wing_rates = _lagged_alpha(wing_strip, motion, x, p)
    tail_alpha, tail_rates = _lagged_alpha(tail_strip, motion, x, p)
    flow = flow_of(*motion.gusty)
    speed = airspeed(x, motion.wind)
    wing_factor = _slope_factor(p, _aspect_ratio(p))
    tail_factor = _slope_factor(p, p.tail_aspect_ratio)
    of_wing = p._replace(
        lift_slope=wing_factor * p.lift_slope,
        aileron_lift=wing_factor * p.aileron_lift,
        tail_area=0.0,
    )
    of_tail = p._replace(lift_slope=tail_factor * p.lift_slope, chord=0.0)
    wing = panel_loads(flow._replace(alpha=wing_alpha), speed, aileron, 0.0, air, of_wing)
    tail = panel_loads(flow._replace(alpha=tail_alpha), speed, 0.0, elevator, air, of_tail)
    sums = [wing_load + tail_load for wing_load, tail_load in zip(wing, tail, strict=True)]
    return _LaggedPanel(
        loads=PanelLoads(*sums),
        lift_coefficient=of_wing.lift_slope * wing_alpha + of_wing.aileron_lift * aileron,
        rates={**wing_rates, **tail_rates},
    )


def _lagged_alpha(
    strip: _Strip, motion: _PanelMotion, x: Any, p: Any
) -> tuple[Quantity, dict[str, Quantity]]:
    """Return the effective angle of attack of a strip, rad, and the rates of its lag states."""
    # The effective angle is the geometric angle, minus the parts of the angles due to motion,
    # control and gust that have no effect on the lift yet. The geometric angle does not include the
    # control.
    normal_by_rate = p.local_motion * motion.spanwise_rate * strip.behind
    alpha = ca.atan2(motion.calm[2] + normal_by_rate, motion.calm[0]) - strip.downwash
    gust = ca.atan2(motion.gusty[2] + normal_by_rate, motion.gusty[0]) - strip.downwash - alpha
    angle = alpha + strip.control
    half_chords = 2 * flow_of(*motion.gusty).speed / strip.chord
    rates = {
        **lag_rates("lag", strip.name, WAGNER, angle, x, half_chords),
        **lag_rates("gust", strip.name, KUESSNER, gust, x, half_chords),
    }
    lift_lag = p.lift_lag * missing("lag", strip.name, WAGNER, angle, x)
    gust_lag = p.gust_lag * missing("gust", strip.name, KUESSNER, gust, x)
    return alpha + gust - lift_lag - gust_lag, rates


def _tip_moment(
    x: Any, p: Any, speed: Quantity, air: Quantity
) -> tuple[Quantity, dict[str, Quantity]]:
    """Return a hinge moment, ft lbf, and the rates of the lag states of the strip "tip", rad/s."""
    # The hinge moment is that of the lift due to the hinge rate, which varies the angle of attack
    # linearly along an outer wing.
    angle = -p.local_motion * x.dihedral_rate * p.panel_span / (2 * speed)
    tip = angle - p.lift_lag * missing("lag", "tip", WAGNER, angle, x)
    slope = _slope_factor(p, _aspect_ratio(p)) * p.lift_slope
    moment = air * speed**2 / 2 * p.chord * slope * p.panel_span**2 / 6 * tip
    return moment, lag_rates("lag", "tip", WAGNER, angle, x, 2 * speed / p.chord)


def _with_apparent_mass(
    x: Any,
    loads: Loads[Quantity],
    motions: tuple[_PanelMotion, _PanelMotion],
    p: Any,
    air: Quantity,
) -> Loads[Quantity]:
    """Return the loads including the apparent mass of wings and tails."""
    # The accelerations a = (w_b', q', η''), w_b = V sin α, solve (M + M_a) a = M a_0. M is the
    # inertia of the aircraft, and M_a the inertia of the carried air (`_carried_air`). a_0 are the
    # accelerations due to all loads except -M_a a.
    others = _CarriedAir(0.0, 0.0, loads.pitching_moment, loads.hinge_moment, ca.DM(3, 3))
    carried = [_carried_air(plate, motion, x, p) for motion in motions for plate in _plates(p, air)]
    forward, downward, pitching_moment, hinge_moment, mass = (
        sum(parts, first) for first, *parts in zip(others, *carried, strict=True)
    )
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    unaccelerated = _with_forces(x, loads, forward, downward, pitching_moment, hinge_moment)
    base = rates_from_loads(x, unaccelerated, p, NEWTON)
    descent_rate = base.speed * ca.sin(x.alpha) + x.speed * ca.cos(x.alpha) * base.alpha
    accelerations = ca.vertcat(descent_rate, base.pitch_rate, base.dihedral_rate)
    # The coefficient c2 is that of the pitch equation (`hfa_model.dynamics`).
    c2 = 2 * p.inertia_yaw - 2 * p.inertia_pitch + p.panel_mass * p.panel_span**2 / 6
    pitch_inertia = 3 * p.inertia_pitch + c2 * sin_eta**2
    hinge_inertia = 2 * NEWTON.hinge_inertia(x.dihedral, p)
    inertia = ca.diag(ca.vertcat(3 * p.panel_mass, pitch_inertia, hinge_inertia))
    # Both matrices are symmetric and their sum is positive definite. The L D L' factorization is
    # more accurate than a symbolic QR.
    factors = ca.ldl(inertia + mass)
    forces = mass @ (accelerations - ca.ldl_solve(mass @ accelerations, *factors))
    # The generalized force of η'' is that of two hinge moments, and of the vertical force by the
    # motion (s/3) cos η of the center of mass.
    hinge_force = (forces[2] - p.panel_span / 3 * cos_eta * forces[0]) / 2
    return _with_forces(
        x,
        loads,
        forward,
        downward - forces[0],
        pitching_moment - forces[1],
        hinge_moment - hinge_force,
    )


def _carried_air(plate: _Plate, motion: _PanelMotion, x: Any, p: Any) -> _CarriedAir:
    """Return the loads of the air carried by the center panel or both outer panels."""
    # A plate of half chord b rotates at the rate ω about its span. The mid-chord of the plate has
    # the normal velocity w and the forward velocity u. The momentum of the carried air is m w
    # normal to the plate, m = π ρ b² span. The angular momenta are (m b²/8) ω about the span and (m
    # span²/12) η' about the chord. The force is -(m w n)' with the unit normal n. Its components
    # are -m w' normal to the plate, -m w ω forward and m w η' toward the center.
    # The moment -m u (b/2) ω of Theodorsen's lift at the three-quarter chord is added here, because
    # the circulatory lift at the quarter chord omits this moment.
    is_center = motion.panel == "center"
    sin_eta = ca.sin(x.dihedral)
    cos_eta = ca.cos(x.dihedral)
    third = p.panel_span / 3
    headwind = motion.wind.headwind
    # Cosine and sine of the dihedral of the plate.
    lean = 1.0 if is_center else cos_eta
    bend = 0.0 if is_center else sin_eta
    height = center_height(x.dihedral, p) if is_center else outer_height(x.dihedral, p)
    forward_speed = motion.calm[0]
    normal_speed = motion.calm[2] + motion.spanwise_rate * plate.aft

    # w' = direction . (w_b', q', η'') + terms that depend only on velocities.
    by_hinge = third * cos_eta * lean - (0.0 if is_center else p.panel_span / 2)
    direction = ca.vertcat(lean, plate.aft * lean, by_hinge)
    hinge_descent = (
        x.speed * ca.sin(x.alpha) + third * cos_eta * x.dihedral_rate + headwind * ca.sin(x.pitch)
    )
    hinge_descent_rate = (
        third * sin_eta * -(x.dihedral_rate**2) + headwind * ca.cos(x.pitch) * x.pitch_rate
    )
    normal_acceleration = lean * hinge_descent_rate - bend * x.dihedral_rate * (
        hinge_descent + plate.aft * x.pitch_rate
    )

    along = -plate.mass * normal_speed * motion.spanwise_rate
    across = -plate.mass * normal_acceleration
    inward = plate.mass * normal_speed * x.dihedral_rate
    down = across * lean + inward * bend
    roll_inertia = plate.mass * plate.span**2 / 12
    pitch_inertia = plate.mass * plate.half_chord**2 / 8
    lift_moment = lean * plate.mass * forward_speed * plate.half_chord / 2 * motion.spanwise_rate
    moment = plate.aft * down + height * along - lift_moment
    turning = 2 * pitch_inertia * lean * bend * x.pitch_rate * x.dihedral_rate
    count = 1 if is_center else 2
    hinge_moment: Quantity = 0.0
    if not is_center:
        centrifugal = pitch_inertia * lean * bend * x.pitch_rate**2
        hinge_moment = -(p.panel_span / 2 * across + centrifugal)
    inertias = ca.vertcat(0.0, pitch_inertia * lean**2, 0.0 if is_center else roll_inertia)
    return _CarriedAir(
        forward=count * along,
        downward=count * down,
        pitching_moment=count * (moment + turning),
        hinge_moment=hinge_moment,
        mass=count * (ca.diag(inertias) + plate.mass * direction @ direction.T),
    )


def _with_forces(
    x: Any,
    loads: Loads[Quantity],
    forward: Quantity,
    downward: Quantity,
    pitching_moment: Quantity,
    hinge_moment: Quantity,
) -> Loads[Quantity]:
    """Return the loads with added body-axis forces and replaced moments."""
    sin_alpha = ca.sin(x.alpha)
    cos_alpha = ca.cos(x.alpha)
    return loads._replace(
        lift=loads.lift + (forward * sin_alpha - downward * cos_alpha),
        drag=loads.drag - (forward * cos_alpha + downward * sin_alpha),
        pitching_moment=pitching_moment,
        hinge_moment=hinge_moment,
    )


def _plates(p: Any, air: Quantity) -> tuple[_Plate, _Plate]:
    """Return the wing and the tail of a panel as plates that carry air."""
    tail_chord = _tail_chord(p)
    wing_volume = p.chord**2 * p.panel_span
    tail_volume = p.tail_area * tail_chord
    wing = _Plate(
        mass=p.apparent_mass * math.pi * air * wing_volume / 4,
        half_chord=p.chord / 2,
        span=p.panel_span,
        aft=p.chord / 4,
    )
    tail = _Plate(
        mass=p.apparent_mass * math.pi * air * tail_volume / 4,
        half_chord=tail_chord / 2,
        span=p.tail_area / tail_chord,
        aft=p.boom_length + tail_chord / 4,
    )
    return wing, tail


#: The aircraft without lags.
_RIGID = rigid_panels(variant_named("published"), default_parameters().values)


def _signals() -> dict[str, Signal]:
    """Return the parameters of the model, name -> signal."""
    # The parameters are the identified parameters of the aircraft, the effects with start value 1,
    # and `tail_aspect_ratio` with start value 10.
    values = default_parameters().values._asdict()
    identified = {
        name: signal._replace(start=float(values[name]))
        for name, signal in _RIGID.parameters.items()
    }
    effects = {name: Signal("1", nominal=1.0, min=0.0, max=2.0, start=1.0) for name in EFFECTS}
    # The area of the tail is known but not its shape: 20 ft by 2 ft are assumed.
    return {
        **identified,
        **effects,
        "tail_aspect_ratio": Signal("1", nominal=10.0, min=0.1, max=1000.0, start=10.0),
    }


#: The aircraft with its identified parameters and all effects at 1.
UNSTEADY = replace(
    _RIGID,
    name="unsteady",
    states={**STATE_SIGNALS._asdict(), **dict.fromkeys(LAG_STATES, Signal("rad", 0.1))},
    equations=unsteady_equations,
    parameters=_signals(),
    steady=tuple(name for name in (*STATES, *LAG_STATES) if name != "altitude"),
    # Only wind changes the gust states. No input reaches them, so critics cannot be learned for
    # them.
    linear=(*LINEAR_STATES, *_LAGS, "downwash"),
    modes={**_RIGID.modes, "lag": (*_LAGS, "downwash"), "gust": _GUSTS},
    parts={"short_period": ("alpha", *_LAGS, "downwash")},
    about=hfa_about("unsteady"),
)


def unsteady_aircraft(parameters: Parameters) -> Model:
    """Return the aircraft with `unsteady` dynamics, the given parameters and all effects at 1."""
    return UNSTEADY.with_parameters(**parameters._asdict())
