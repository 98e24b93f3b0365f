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

from hfa_aircraft.signals import Signal
from hfa_model.atmosphere import air_at
from hfa_model.declaration import hfa_about, rigid_panels
from hfa_model.dynamics import (
    Loads,
    PanelLoads,
    panel_loads,
    pitch_inertias,
    rates_from_loads,
    sum_of_panels,
)
from hfa_model.kinematics import (
    Velocity,
    Wind,
    airspeed,
    center_height,
    center_velocity,
    flow_of,
    outer_height,
    outer_velocity,
    winds_of,
)
from hfa_model.outputs import OUTPUTS, Instant
from hfa_model.parameters import (
    LINEAR_STATES,
    STATE_SIGNALS,
    STATES,
    Quantity,
    default_parameters,
)
from hfa_model.variants import Newton, variant_named

NEWTON = Newton()


class Lag(NamedTuple):
    """Step response of the lift of a strip, 1 - Σ A_i exp(-b_i s).

    s = V t / b is the distance traveled in half chords b after a unit step at t = 0. Each term is
    the response of a lag state z_i, with z_i' = b_i (V/b) (angle - z_i).

    cause: beginning of the names of the lag states, "lag" for motion and controls, or "gust"
    shares: A_1, A_2
    rates: b_1, b_2
    """

    cause: str
    shares: tuple[float, float]
    rates: tuple[float, float]

    def states(self, strip: str) -> tuple[str, str]:
        """Return the names of both lag states of a strip, such as lag_center_1, lag_center_2."""
        return f"{self.cause}_{strip}_1", f"{self.cause}_{strip}_2"


#: Approximations of Wagner's function (R. T. Jones, NACA 681, 1940) and of Küssner's (Bisplinghoff,
#: Ashley, Halfman, Aeroelasticity, Eq. 5-383).
WAGNER = Lag("lag", (0.165, 0.335), (0.0455, 0.3))
KUESSNER = Lag("gust", (0.5, 0.5), (0.13, 1.0))
#: The wings and tails. `tip` is the linear variation of the angle of attack over an outer wing,
#: given at its tip.
STRIPS = ("center", "outer", "tip", "tail_center", "tail_outer")
_LAGS = tuple(name for strip in STRIPS for name in WAGNER.states(strip))
_GUSTS = tuple(name for strip in STRIPS if strip != "tip" for name in KUESSNER.states(strip))
#: States in addition to the seven of `newton`: lagged angles of each strip due to motion and
#: control, lagged angles due to gusts, and the downwash.
LAG_STATES = (*_LAGS, *_GUSTS, "downwash")
EFFECTS = ("local_motion", "apparent_mass", "lift_lag", "gust_lag", "finite_span", "downwash_share")


class _Panel(NamedTuple):
    """Attitude of the center panel or of one outer panel, and its motion relative to the air."""

    name: str  # "center" or "outer"
    number: int  # how many of these panels the aircraft has
    sin_dihedral: Quantity  # of the dihedral of this panel, 0 for the center panel
    cos_dihedral: Quantity
    hinge_arm: Quantity  # distance of its mid-span from the hinge about which it turns, or 0, ft
    height: Quantity  # distance below the center of mass of the aircraft, ft
    wind: Wind
    # velocity relative to the air with the headwind, but without updraft and outward gust
    calm: Velocity
    gusty: Velocity  # velocity relative to the air with all winds
    spanwise_rate: Quantity  # pitch rate about the spanwise axis of the panel, rad/s


class _Strip(NamedTuple):
    """Wing or tail of a panel."""

    name: str  # "center" or "outer" for the wing, "tail_center" or "tail_outer" for the tail
    control: Quantity  # angle of attack with the same lift as the control deflection, rad
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
    """Loads of the air that the wing or the tail of the panels of one kind carries."""

    # The vertical force, pitching moment and generalized hinge moment are those at zero
    # acceleration minus M_a a, with the accelerations a = (w_b', q', η'') and w_b = V sin α.

    forward: Quantity  # force along the x axis of the body, lbf
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
    air = air_at(x.altitude)
    center = _center_panel(x, p, winds.center)
    outer = _outer_panel(x, p, winds.outer)
    on_center = _lagged_panel(center, x, u, p, air.density)
    on_outer = _lagged_panel(outer, x, u, p, air.density)
    on_panels = sum_of_panels(x, u, on_center.loads, on_outer.loads, p, NEWTON)
    tip_moment, tip_rates = _tip_moment(x, p, flow_of(outer.calm).speed, air.density)
    circulatory = on_panels._replace(hinge_moment=on_panels.hinge_moment + tip_moment)
    loads = _with_apparent_mass(x, circulatory, (center, outer), p, air.density)
    rates = rates_from_loads(x, loads, p, NEWTON)
    lift_coefficient = (on_center.lift_coefficient + 2 * on_outer.lift_coefficient) / 3
    steady_downwash = 2 * lift_coefficient / (math.pi * _aspect_ratio(p))
    downwash_rate = x.speed / p.boom_length * (steady_downwash - x.downwash)
    lag_state_rates = {**on_center.rates, **on_outer.rates, **tip_rates, "downwash": downwash_rate}
    now = Instant(x, u, p, winds, air, loads, rates)
    outputs = {name: output(now) for name, (_, output) in OUTPUTS.items()}
    # The reaction of the apparent mass to accelerations is inertia, not lift.
    outputs["lift"] = circulatory.lift
    outputs["pitching_moment"] = circulatory.pitching_moment
    return {**rates._asdict(), **lag_state_rates}, outputs


def _center_panel(x: Any, p: Any, wind: Wind) -> _Panel:
    """Return the attitude and the motion of the center panel."""
    return _Panel(
        name="center",
        number=1,
        sin_dihedral=0.0,
        cos_dihedral=1.0,
        hinge_arm=0.0,
        height=center_height(x.dihedral, p),
        wind=wind,
        calm=center_velocity(x, p, _headwind(wind)),
        gusty=center_velocity(x, p, wind),
        spanwise_rate=x.pitch_rate,
    )


def _outer_panel(x: Any, p: Any, wind: Wind) -> _Panel:
    """Return the attitude and the motion of an outer panel."""
    cos_dihedral = ca.cos(x.dihedral)
    return _Panel(
        name="outer",
        number=2,
        sin_dihedral=ca.sin(x.dihedral),
        cos_dihedral=cos_dihedral,
        hinge_arm=p.panel_span / 2,
        height=outer_height(x.dihedral, p),
        wind=wind,
        calm=outer_velocity(x, p, _headwind(wind)),
        gusty=outer_velocity(x, p, wind),
        spanwise_rate=x.pitch_rate * cos_dihedral,
    )


def _headwind(wind: Wind) -> Wind:
    """Return the headwind alone, which counts as motion of a panel, not as a gust."""
    return Wind(headwind=wind.headwind)


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


def _missing_angle(lag: Lag, strip: str, angle: Quantity, x: Any) -> Quantity:
    """Return Σ A_i (angle - z_i), the part of an angle that the lift does not follow yet, rad.

    strip: name of the wing, tail or tip
    """
    pairs = zip(lag.shares, lag.states(strip), strict=True)
    return sum(share * (angle - getattr(x, state)) for share, state in pairs)


def _lag_rates(
    lag: Lag, strip: str, angle: Quantity, x: Any, half_chords: Quantity
) -> dict[str, Quantity]:
    """Return name of a lag state z_i -> rate z_i' = b_i (V/b) (angle - z_i), rad/s."""
    # half_chords: V/b, the airspeed in half chords per second
    pairs = zip(lag.rates, lag.states(strip), strict=True)
    return {state: rate * half_chords * (angle - getattr(x, state)) for rate, state in pairs}


def _lagged_panel(panel: _Panel, x: Any, u: Any, p: Any, air_density: Quantity) -> _LaggedPanel:
    """Return the loads on a panel with lagged lift, and the rates of the panel's lag states."""
    # The lift lags behind motion, controls and gusts. The lift is perpendicular to the flow at the
    # lagged angle of attack, because the induced velocity of the wake is part of the flow.
    # `panel_loads` adds the full lift of aileron and elevator at once. The effective angles of
    # attack therefore omit the deflection, and subtract the part of it that does not act yet.
    aileron = getattr(u, f"aileron_{panel.name}")
    elevator = getattr(u, f"elevator_{panel.name}")
    tail_chord = _tail_chord(p)
    wing_strip = _Strip(
        name=panel.name,
        control=p.aileron_lift / p.lift_slope * aileron,
        behind=p.chord / 2,
        downwash=0.0,
        chord=p.chord,
    )
    tail_strip = _Strip(
        name=f"tail_{panel.name}",
        control=elevator,
        behind=p.boom_length + tail_chord / 2,
        downwash=p.downwash_share * x.downwash,
        chord=tail_chord,
    )

    wing_alpha, wing_rates = _effective_angle(wing_strip, panel, x, p)
    tail_alpha, tail_rates = _effective_angle(tail_strip, panel, x, p)

    # `panel_loads` of a panel without tail are the loads on the wing, and those of a panel without
    # wing chord the loads on the tail. The lift slopes are those of the finite spans.
    wing_factor = _slope_factor(p, _aspect_ratio(p))
    wing_alone = p._replace(
        lift_slope=wing_factor * p.lift_slope,
        aileron_lift=wing_factor * p.aileron_lift,
        tail_area=0.0,
    )
    tail_factor = _slope_factor(p, p.tail_aspect_ratio)
    tail_alone = p._replace(lift_slope=tail_factor * p.lift_slope, chord=0.0)

    flow = flow_of(panel.gusty)
    wing_flow = flow._replace(alpha=wing_alpha)
    tail_flow = flow._replace(alpha=tail_alpha)
    speed = airspeed(x, panel.wind)
    on_wing = panel_loads(wing_flow, speed, aileron, 0.0, air_density, wing_alone)
    on_tail = panel_loads(tail_flow, speed, 0.0, elevator, air_density, tail_alone)
    sums = (of_wing + of_tail for of_wing, of_tail in zip(on_wing, on_tail, strict=True))
    return _LaggedPanel(
        loads=PanelLoads(*sums),
        lift_coefficient=wing_alone.lift_slope * wing_alpha + wing_alone.aileron_lift * aileron,
        rates={**wing_rates, **tail_rates},
    )


def _effective_angle(
    strip: _Strip, panel: _Panel, x: Any, p: Any
) -> tuple[Quantity, dict[str, Quantity]]:
    """Return the effective angle of attack of a strip, rad, and the rates of its lag states."""
    # The effective angle is the geometric angle by motion and gust, minus the parts of the angles
    # by motion, control and gust that the lift does not follow yet.
    turning = p.local_motion * panel.spanwise_rate * strip.behind
    calm, gusty = panel.calm, panel.gusty
    by_motion = ca.atan2(calm.downward + turning, calm.forward) - strip.downwash
    by_gust = ca.atan2(gusty.downward + turning, gusty.forward) - strip.downwash - by_motion
    with_control = by_motion + strip.control
    half_chords = 2 * flow_of(gusty).speed / strip.chord
    rates = {
        **_lag_rates(WAGNER, strip.name, with_control, x, half_chords),
        **_lag_rates(KUESSNER, strip.name, by_gust, x, half_chords),
    }
    lift_lag = p.lift_lag * _missing_angle(WAGNER, strip.name, with_control, x)
    gust_lag = p.gust_lag * _missing_angle(KUESSNER, strip.name, by_gust, x)
    return by_motion + by_gust - lift_lag - gust_lag, rates


def _tip_moment(
    x: Any, p: Any, speed: Quantity, air_density: Quantity
) -> tuple[Quantity, dict[str, Quantity]]:
    """Return the hinge moment of the lift that the hinge rate causes, ft lbf, and the rates of the
    lag states of the strip "tip", rad/s."""
    # The hinge rate changes the angle of attack of an outer wing at the distance y from the hinge,
    # relative to mid-span, by α_tip (2 y/s - 1), α_tip = -η' s / (2 V). The lift of this change has
    # the hinge moment ∫ q̄ c a α_tip (2 y/s - 1) y dy = q̄ c a α_tip s²/6, with the lift slope a.
    geometric = -p.local_motion * x.dihedral_rate * p.panel_span / (2 * speed)
    effective = geometric - p.lift_lag * _missing_angle(WAGNER, "tip", geometric, x)
    slope = _slope_factor(p, _aspect_ratio(p)) * p.lift_slope
    moment = air_density * speed**2 / 2 * p.chord * slope * p.panel_span**2 / 6 * effective
    return moment, _lag_rates(WAGNER, "tip", geometric, x, 2 * speed / p.chord)


def _with_apparent_mass(
    x: Any,
    loads: Loads[Quantity],
    panels: tuple[_Panel, _Panel],
    p: Any,
    air_density: Quantity,
) -> Loads[Quantity]:
    """Return the loads including the apparent mass of wings and tails."""
    # The accelerations a = (w_b', q', η''), w_b = V sin α, solve (M + M_a) a = M a_0. M is the
    # inertia of the aircraft, and M_a the inertia of the carried air (`_carried_air`). a_0 are the
    # accelerations due to all loads except -M_a a.
    plates = _plates(p, air_density)
    carried = [_carried_air(plate, panel, x, p) for panel in panels for plate in plates]
    all_air = _CarriedAir(*(sum(parts) for parts in zip(*carried, strict=True)))

    # a_0 and M
    rates = rates_from_loads(x, _with_air(loads, all_air, x), p, NEWTON)
    descent_rate = rates.speed * ca.sin(x.alpha) + x.speed * ca.cos(x.alpha) * rates.alpha
    accelerations = ca.vertcat(descent_rate, rates.pitch_rate, rates.dihedral_rate)
    hinge_inertia = 2 * NEWTON.hinge_inertia(x.dihedral, p)
    c1, c2 = pitch_inertias(p)
    pitch_inertia = c1 + c2 * ca.sin(x.dihedral) ** 2
    inertia = ca.diag(ca.vertcat(3 * p.panel_mass, pitch_inertia, hinge_inertia))

    # Both matrices are symmetric and their sum is positive definite. The L D L' factorization is
    # more accurate than a symbolic QR. forces = M_a a = M_a (a_0 - (M + M_a)⁻¹ M_a a_0).
    factors = ca.ldl(inertia + all_air.mass)
    forces = all_air.mass @ (accelerations - ca.ldl_solve(all_air.mass @ accelerations, *factors))

    # The generalized force of η'' is 2 H + (s/3) cos η Z, with the hinge moment H and the vertical
    # force Z: the center of mass moves by (s/3) cos η η'.
    hinge_force = (forces[2] - p.panel_span / 3 * ca.cos(x.dihedral) * forces[0]) / 2
    accelerated_air = all_air._replace(
        downward=all_air.downward - forces[0],
        pitching_moment=all_air.pitching_moment - forces[1],
        hinge_moment=all_air.hinge_moment - hinge_force,
    )
    return _with_air(loads, accelerated_air, x)


def _carried_air(plate: _Plate, panel: _Panel, x: Any, p: Any) -> _CarriedAir:
    """Return the loads of the air that the wings or tails of the center or both outer panels carry.

    plate: wing or tail of one of these panels
    """
    # A plate of half chord b turns at the rate ω about its span and η' about its chord. Its
    # mid-chord has the normal velocity w and the forward velocity u. The momentum of the carried
    # air is m w normal to the plate, m = π ρ b² span. The angular momenta are (m b²/8) ω about the
    # span and (m span²/12) η' about the chord. The force is -(m w n)' with the unit normal n. Its
    # components are -m w' normal to the plate, -m w ω forward and m w η' toward the center.
    # The moment -m u (b/2) ω of Theodorsen's lift at the three-quarter chord is added here, because
    # the circulatory lift at the quarter chord omits this moment.
    # The inertia about the pitch axis, (m b²/8) cos² η, changes with the dihedral η of the panel:
    # Lagrange's equations then contain the terms `gyroscopic` in q' and `centrifugal` in η''.

    # Forces on the plate at zero acceleration
    turning = panel.spanwise_rate
    normal_speed = panel.calm.downward + turning * plate.aft
    slopes, steady_acceleration = _normal_acceleration(plate, panel, x, p)
    forward = -plate.mass * normal_speed * turning
    normal = -plate.mass * steady_acceleration
    inward = plate.mass * normal_speed * x.dihedral_rate
    sin_panel = panel.sin_dihedral
    cos_panel = panel.cos_dihedral
    downward = normal * cos_panel + inward * sin_panel

    # Moments at zero acceleration
    pitch_inertia_of_air = plate.mass * plate.half_chord**2 / 8
    lift_moment = cos_panel * plate.mass * panel.calm.forward * plate.half_chord / 2 * turning
    gyroscopic = 2 * pitch_inertia_of_air * cos_panel * sin_panel * x.pitch_rate * x.dihedral_rate
    moment = plate.aft * downward + panel.height * forward - lift_moment
    centrifugal = pitch_inertia_of_air * cos_panel * sin_panel * x.pitch_rate**2

    # Inertias with respect to the accelerations (w_b', q', η'')
    turns_about_hinge = panel.name == "outer"  # only outer panels turn about their chords
    roll_inertia_of_air = plate.mass * plate.span**2 / 12 if turns_about_hinge else 0.0
    inertias = ca.vertcat(0.0, pitch_inertia_of_air * cos_panel**2, roll_inertia_of_air)
    return _CarriedAir(
        forward=panel.number * forward,
        downward=panel.number * downward,
        pitching_moment=panel.number * (moment + gyroscopic),
        hinge_moment=-(panel.hinge_arm * normal + centrifugal),
        mass=panel.number * (ca.diag(inertias) + plate.mass * slopes @ slopes.T),
    )


def _normal_acceleration(plate: _Plate, panel: _Panel, x: Any, p: Any) -> tuple[ca.SX, Quantity]:
    """Return `slopes` (3,) and `steady` of w' = slopes · (w_b', q', η'') + steady of a plate."""
    # w is the normal velocity of its mid-chord, in a constant headwind h, and w_b = V sin α.
    # With the descent w_h of the hinge (`center_velocity`), its arm r, the panel span s, and the
    # distance `aft` of the mid-chord behind the wing's quarter chord,
    # w = (w_h + aft q) cos η_p - r η', and w_h' = w_b' + (s/3) (cos η η')' + h cos θ q. η_p is the
    # dihedral of the panel, 0 or η. `steady` contains the terms without w_b', q' and η''.
    cos_eta = ca.cos(x.dihedral)
    third = p.panel_span / 3
    headwind = _headwind(panel.wind)
    descent = center_velocity(x, p, headwind).downward
    steady_descent_rate = (
        third * ca.sin(x.dihedral) * -(x.dihedral_rate**2)
        + headwind.headwind * ca.cos(x.pitch) * x.pitch_rate
    )
    steady = panel.cos_dihedral * steady_descent_rate - panel.sin_dihedral * x.dihedral_rate * (
        descent + plate.aft * x.pitch_rate
    )
    slopes = ca.vertcat(
        panel.cos_dihedral,
        plate.aft * panel.cos_dihedral,
        third * cos_eta * panel.cos_dihedral - panel.hinge_arm,
    )
    return slopes, steady


def _with_air(loads: Loads[Quantity], air: _CarriedAir, x: Any) -> Loads[Quantity]:
    """Return the sum of the loads and those of carried air, in the axes of the flight path."""
    sin_alpha = ca.sin(x.alpha)
    cos_alpha = ca.cos(x.alpha)
    return loads._replace(
        lift=loads.lift + (air.forward * sin_alpha - air.downward * cos_alpha),
        drag=loads.drag - (air.forward * cos_alpha + air.downward * sin_alpha),
        pitching_moment=loads.pitching_moment + air.pitching_moment,
        hinge_moment=loads.hinge_moment + air.hinge_moment,
    )


def _plates(p: Any, air_density: Quantity) -> tuple[_Plate, _Plate]:
    """Return the wing and the tail of a panel as plates that carry air."""
    # The apparent mass is π ρ b² per length, times the share of this effect, `apparent_mass`. The
    # mid-chord is a quarter of the chord behind the quarter chord.
    tail_chord = _tail_chord(p)
    wing_volume = p.chord**2 * p.panel_span
    tail_volume = p.tail_area * tail_chord
    wing = _Plate(
        mass=p.apparent_mass * math.pi * air_density * wing_volume / 4,
        half_chord=p.chord / 2,
        span=p.panel_span,
        aft=p.chord / 4,
    )
    tail = _Plate(
        mass=p.apparent_mass * math.pi * air_density * tail_volume / 4,
        half_chord=tail_chord / 2,
        span=p.tail_area / tail_chord,
        aft=p.boom_length + tail_chord / 4,
    )
    return wing, tail


#: The aircraft in quasi-steady air.
_QUASI_STEADY = rigid_panels(variant_named("published"), default_parameters().values)


#: The aircraft with its identified parameters and all effects at 1.
UNSTEADY = replace(
    _QUASI_STEADY,
    name="unsteady",
    states={**STATE_SIGNALS._asdict(), **dict.fromkeys(LAG_STATES, Signal("rad", 0.1))},
    equations=unsteady_equations,
    parameters={
        **_QUASI_STEADY.parameters,
        **dict.fromkeys(EFFECTS, Signal("1", nominal=1.0, min=0.0, max=2.0, start=1.0)),
        # The area of the tail is known but not its shape: 20 ft by 2 ft are assumed.
        "tail_aspect_ratio": Signal("1", nominal=10.0, min=0.1, max=1000.0, start=10.0),
    },
    steady=tuple(name for name in (*STATES, *LAG_STATES) if name != "altitude"),
    # Only wind changes the gust states. No input reaches them, so critics cannot be learned for
    # them.
    linear=(*LINEAR_STATES, *_LAGS, "downwash"),
    modes={**_QUASI_STEADY.modes, "lag": (*_LAGS, "downwash"), "gust": _GUSTS},
    parts={"short_period": ("alpha", *_LAGS, "downwash")},
    about=hfa_about("unsteady"),
)
