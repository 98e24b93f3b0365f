"""Propellers with fixed, adjustable or governed blades (`FGPropeller`)."""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca

from hfa_jsbsim.engines import (
    HP,
    STEP,
    Effect,
    EngineFile,
    HostAircraft,
    engine_rpm,
    internal_table,
    orientation,
    own_property,
    thrust_force_and_moment,
    thruster_location,
)

#: Fraction of the remaining angle by which the blades feather in each of JSBSim's frames.
_FEATHERING = 1.0 / 300.0


def propeller_effect(file: EngineFile, aircraft: HostAircraft, power: Any) -> Effect:
    """Return the force, moment and power of a propeller, as an `Effect`.

    C_T and C_P are tables over J = V / (n D) and the blade angle. The thrust is C_T ρ n² D⁴, and
    the absorbed power is C_P ρ n³ D⁵. An engine at rest absorbs no power (`FGPiston::Calculate`).

    power: power of the engine, ft lb/s
    """
    prop = file.thruster
    power = ca.if_else(engine_rpm(file, aircraft) > 0.1, power, ca.fmax(power, 0.0))
    diameter = max(prop.value_of("diameter", 0.001, "FT"), 0.001)
    axes, location = orientation(file, aircraft.properties), thruster_location(file, aircraft)
    flow = _flow(file, aircraft, axes, location, diameter)
    blade, blade_rates = _blade(file, aircraft)
    thrust_coefficient = _coefficient(file, aircraft, "C_THRUST", flow, blade)
    power_coefficient = _coefficient(file, aircraft, "C_POWER", flow, blade)
    density, turns = aircraft.motion.air.density, flow.turns
    thrust = thrust_coefficient * turns**2 * diameter**4 * density
    absorbed = power_coefficient * turns**3 * diameter**5 * density
    induced = _induced_velocity(flow.velocity[0], thrust, density, diameter)
    inertia = max(prop.value_of("ixx", 1e-6, "SLUG*FT2"), 1e-6)
    omega = ca.fmax(2.0 * math.pi * turns, 0.01)
    sense = 1.0 if file.thruster_mount.value_of("sense", 1.0) >= 0.0 else -1.0
    # As in JSBSim, the sign of the gyroscopic moment depends on the version of the file.
    version = float(prop.attributes.get("version", "0") or "0")
    momentum = inertia * omega * sense * (-1.0 if version > 1.0 else 1.0)
    gyroscopic = ca.cross(aircraft.motion.rates, axes[:, 0] * momentum)
    own_moment = gyroscopic - axes[:, 0] * sense * power / omega
    acting = _acting_location(file, location, flow.velocity, induced, sense)
    force, moment = thrust_force_and_moment(file, aircraft, thrust, acting, own_moment)
    speed_rate = (power - absorbed) / omega / inertia * 30.0 / math.pi
    rpm = getattr(aircraft.states, f"rpm{file.number}")
    # The propeller does not turn backwards: at rest, a braking torque has no effect.
    speed_rate = ca.if_else(rpm + speed_rate * STEP > 0.0, speed_rate, -rpm / STEP)
    return Effect(
        force,
        moment,
        thrust,
        power / HP,
        {f"rpm{file.number}": speed_rate, **blade_rates},
        {
            "propeller-torque-ftlb": -sense * power / omega,
            "thrust-coefficient": thrust_coefficient,
            "advance-ratio": flow.advance,
            "prop-induced-velocity_fps": induced,
            "helical-tip-Mach": flow.tip_mach,
        },
    )


class _Flow(NamedTuple):
    """Airflow at a propeller.

    velocity: velocity of the propeller in the air, in the thruster's axes, ft/s, (3,)
    turns: revolutions per second
    advance: advance ratio V / (n D)
    tip_mach: Mach number of the tips
    """

    velocity: ca.SX
    turns: Any
    advance: Any
    tip_mach: Any


def _flow(
    file: EngineFile, aircraft: HostAircraft, axes: ca.SX, location: ca.SX, diameter: float
) -> _Flow:
    """Return the airflow at a propeller with these axes, location and diameter, ft."""
    motion = aircraft.motion
    at_propeller = motion.air_velocity + ca.cross(motion.rates, aircraft.mass.arm(location))
    velocity = ca.mtimes(axes.T, at_propeller)
    turns = getattr(aircraft.states, f"rpm{file.number}") / 60.0
    advance = velocity[0] / (diameter * ca.fmax(turns, 0.01))
    tip_speed = ca.sqrt((turns * diameter * math.pi) ** 2 + velocity[0] ** 2)
    return _Flow(velocity, turns, advance, tip_speed / motion.air.sound)


def _blade(file: EngineFile, aircraft: HostAircraft) -> tuple[Any, dict[str, Any]]:
    """Return the blade angle of a propeller, deg, and {state: its derivative}, empty without one.

    A governor changes the angle by 1 deg/s for each rpm above the commanded speed. If the propeller
    is feathered, the angle approaches `maxpitch`, by the share `_FEATHERING` of the remaining
    difference in each frame. A step that would exceed a limit of the angle ends at the limit.
    """
    prop = file.thruster
    lowest = prop.value_of("minpitch", 0.0)
    highest = prop.value_of("maxpitch", 0.0)
    if not file.governed:
        return own_property(file, aircraft, "blade-angle", lowest), {}
    blade = getattr(aircraft.states, f"blade{file.number}")
    slowest = prop.value_of("minrpm", 0.0)
    advance: Any = 0.0
    feather: Any = 0.0
    if file.kind != "turbine_engine":  # `FGTurbine` does not pass on the levers
        where = file.mount.where
        advance = aircraft.properties.read(f"fcs/advance-pos-norm[{file.number}]", where)
        feather = aircraft.properties.read(f"fcs/feather-pos-norm[{file.number}]", where)
    wanted = slowest + (prop.value_of("maxrpm", 0.0) - slowest) * advance
    rate = getattr(aircraft.states, f"rpm{file.number}") - wanted
    rate = ca.if_else(ca.SX(feather) > 0.5, (highest - blade) * _FEATHERING / STEP, rate)
    next_blade = ca.fmin(ca.fmax(blade + rate * STEP, lowest), highest)
    return blade, {f"blade{file.number}": (next_blade - blade) / STEP}


def _coefficient(
    file: EngineFile, aircraft: HostAircraft, name: str, flow: _Flow, blade: Any
) -> Any:
    """Return C_T or C_P with its factor and Mach correction."""
    prop = file.thruster
    tables = {table.attributes.get("name", ""): table for table in prop.all("table")}
    if name not in tables:
        raise prop.error(f"the propeller has no table {name}; add this table")
    fixed = prop.value_of("minpitch", 0.0) == prop.value_of("maxpitch", 0.0)
    arguments = [flow.advance] if fixed else [flow.advance, blade]
    value = internal_table(tables[name], aircraft, arguments)
    factor, mach = ("ct_factor", "CT_MACH") if name == "C_THRUST" else ("cp_factor", "CP_MACH")
    value = value * prop.value_of(factor, 1.0)
    if mach in tables:
        value = value * internal_table(tables[mach], aircraft, [flow.tip_mach])
    return value


def _induced_velocity(speed: Any, thrust: Any, density: Any, diameter: float) -> Any:
    """Return the induced velocity according to momentum theory, ft/s."""
    area = 0.25 * math.pi * diameter**2
    squared = speed * ca.fabs(speed) + 2.0 * thrust / (density * area)
    root = ca.sqrt(ca.fmax(ca.fabs(squared), 1e-12))
    return 0.5 * (-speed + ca.if_else(squared > 0.0, root, -root))


def _acting_location(
    file: EngineFile, location: ca.SX, local: Any, induced: Any, sense: float
) -> Any:
    """Return the point where the thrust acts, inches, which the P-factor moves with the flow angle.

    local: velocity of the propeller in the air, in the thruster's axes, (3,)
    """
    factor = file.thruster_mount.value_of("p_factor", 0.0)
    if factor <= 0.0001:
        return location
    across = ca.sqrt(ca.fmax(local[1] ** 2 + local[2] ** 2, 1e-8))
    shift = sense * factor * ca.atan2(across, local[0] + induced) / across
    return location + ca.vertcat(0.0, shift * local[2], shift * local[1])
