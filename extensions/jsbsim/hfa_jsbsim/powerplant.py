"""Force, moment and power of an engine together with its thruster, and the properties it sets."""

from __future__ import annotations

import math
from functools import partial
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_jsbsim.engines import (
    HP,
    STEP,
    Effect,
    MountedEngine,
    commanded_speed,
    electric_power,
    internal_table,
    jet,
    lag_rates,
    orientation,
    rocket_thrust,
    running,
    thrust_force_and_moment,
    thruster_location,
    turbine_thrust,
    turboprop_power,
    windmilling_speed,
)
from hfa_jsbsim.properties import BEFORE_ALL, Writer
from hfa_jsbsim.xml_file import Element
from hfa_support.units import FOOT

_PSF_TO_PA = 47.88
_INHG_TO_PA = 3386.38
_PSI_TO_PA = 6895.0
_IN3_TO_M3 = (FOOT / 12.0) ** 3
_STANDARD_PRESSURE = 101320.73
_GAS_CONSTANT = 287.3
#: Least mean speed of the pistons, ft/s, which avoids a division by 0.
_SLOWEST = 1e-4
#: Fuel-air ratios, and the fractions of the power that are available at them.
_MIXTURE = (
    np.array(
        [
            *(0.05, 0.05137, 0.05179, 0.0543, 0.05842, 0.06312, 0.06942, 0.07786),
            *(0.08845, 0.0927, 0.1012, 0.11455, 0.12158, 0.12435, 0.125),
        ]
    ),
    np.array(
        [
            *(0.0, 0.00862, 0.21552, 0.48276, 0.7069, 0.83621, 0.93103, 1.0),
            *(1.0, 0.98276, 0.93103, 0.72414, 0.4569, 0.23276, 0.0),
        ]
    ),
)


class PistonPower(NamedTuple):
    """Power of a piston engine, hp, and what else it sets.

    properties: last part of the name -> value
    rates: {manifold pressure state: time derivative, inHg/s}, empty if the pressure is not a state
    """

    horsepower: Any
    properties: dict[str, Any]
    rates: dict[str, Any]


def piston_power(mounted: MountedEngine) -> PistonPower:
    """Return the power of a piston engine.

    It is the indicated power, less the static friction and the power of the supercharger, plus the
    power of the mean pressure p in the cylinders, p V n / cycles, of pumping and friction.
    """
    engine = mounted.engine
    air = mounted.motion.air
    ambient = air.pressure * _PSF_TO_PA
    speed = mounted.rpm
    breathing = _Breathing(engine)
    piston_speed = speed * breathing.stroke / 360.0  # ft/s: two strokes in inches per turn

    # Pressure behind the throttle, with a lag if it is a state, and in the manifold.
    ratio = breathing.pressure_ratio(mounted.throttle, piston_speed)
    throttled = _ram_pressure(mounted, ambient) * ratio
    rates = {}
    state = mounted.lag_state
    if state is not None:
        delay = engine.value_of("man-press-lag", 1.0)
        rates[mounted.lag] = (throttled / _INHG_TO_PA - state) / delay
        throttled = state * _INHG_TO_PA
    manifold = _boosted(mounted, throttled, ambient, speed)

    # Mass flow of the air.
    efficiency = _settable(mounted, "volumetric-efficiency", 0.85)
    displacement = engine.value_of("displacement", 360.0, "IN3") * _IN3_TO_M3
    swept = displacement * (speed / 60.0) / 2.0  # an intake every second turn
    volume_flow = swept * efficiency * _exhaust_factor(engine, ambient, manifold)
    air_flow = volume_flow * manifold / (_GAS_CONSTANT * (air.temperature / 1.8))

    # Power of the fuel and of the pressures. Without ignition the propeller drags the engine.
    own_friction = engine.value_of("static-friction", 1.5, "HP")
    static_friction = mounted.own("friction-hp", own_friction)
    runs = running(mounted)
    of_fuel = _power_of_fuel(mounted, breathing, air_flow)
    indicated = ca.if_else(runs, of_fuel - static_friction, -static_friction)
    friction = ca.if_else(runs, _friction_pressure(engine, piston_speed), 0.0)
    pumping = (throttled - ambient) * efficiency
    cycles = engine.value_of("cycles", 4.0)
    # In hp: 22371 = 60 s/min x 745.7 W/hp / (2 strokes per turn)
    of_pressures = (pumping + friction) * displacement * speed / (cycles * 22371)
    power = indicated + of_pressures - _boost_loss(engine, throttled, manifold, volume_flow)
    return PistonPower(power, {"map-pa": manifold, "map-inhg": manifold / _INHG_TO_PA}, rates)


def _ram_pressure(mounted: MountedEngine, ambient: Any) -> Any:
    """Return the pressure in front of the air box, Pa."""
    total = mounted.read("propulsion/pt-lbs_sqft") * _PSF_TO_PA
    return (total - ambient) * _settable(mounted, "ram-air-factor", 1.0) + ambient


def _exhaust_factor(engine: Element, ambient: Any, manifold: Any) -> Any:
    """Return the fraction of the cylinder that exhaust gas leaves free for fresh air."""
    compression = engine.value_of("compression-ratio", 8.5)
    back_ratio = ca.fmin(ambient / ca.fmax(manifold, 1.0), compression)
    # 1.3: ratio of the specific heats
    return 0.3 / 1.3 + (compression - back_ratio) / (1.3 * (compression - 1.0))


def _power_of_fuel(mounted: MountedEngine, breathing: _Breathing, air_flow: Any) -> Any:
    """Return the power of the fuel that burns with an air flow, kg/s, in hp."""
    lever = mounted.read(f"fcs/mixture-cmd-norm[{mounted.number}]")
    position = f"fcs/mixture-pos-norm[{mounted.number}]"
    mixture = mounted.properties.read_or(position, lever, mounted.mount.where)
    ambient = mounted.motion.air.pressure * _PSF_TO_PA
    # Of the stoichiometric 1 to 14.7: 1.3 at sea level with the lever at 1, and more in thin air.
    fuel_share = 1.3 * mixture * 101325.0 / ambient / 14.7
    fuel_flow = air_flow * fuel_share * 2.2046 * 3600.0  # lb/h
    consumption = _own_consumption(mounted.engine, breathing)
    power = fuel_flow / mounted.own("bsfc-lbs_hphr", consumption)
    return power * _mixture_efficiency(mounted, fuel_share)


def _friction_pressure(engine: Element, piston_speed: Any) -> Any:
    """Return the mean pressure of friction in the cylinders, Pa, negative."""
    dynamic = -engine.value_of("dynamic-fmep", 18400.0, "PA") * piston_speed * FOOT
    return dynamic - engine.value_of("static-fmep", 46500.0, "PA")


def _settable(mounted: MountedEngine, name: str, default: float) -> Any:
    """Return a number of a piston engine, which the engine's file or a system can set."""
    return mounted.own(name, mounted.engine.value_of(name, default))


class _Breathing:
    """Flow resistance of the air box and throttle of a piston engine.

    The pressure behind the throttle is that before the air box times the share of the cylinders'
    impedance in the sum of impedances. `air_box` gives the manifold pressure `maxmp` at the rated
    speed with open throttle, `throttle` gives `minmp` at idle.
    """

    def __init__(self, engine: Element) -> None:
        self.stroke = engine.value_of("stroke", 4.375, "IN")
        self.fastest = engine.value_of("maxrpm", 2800.0)
        self.peak_speed = engine.value_of("peak-piston-speed", 100.0)
        idle = engine.value_of("idlerpm", 600.0)
        lowest = engine.value_of("minmp", 6.5, "INHG") * _INHG_TO_PA
        self.highest_inhg = engine.value_of("maxmp", 28.5, "INHG")
        highest = min(self.highest_inhg, 29.9) * _INHG_TO_PA
        self.rated_speed = self.fastest * self.stroke / 360.0
        self.air_box = engine.value_of("air-intake-impedance-factor", -999.0)
        if self.air_box < 0.0:
            impedance = self.peak_speed / self.rated_speed
            self.air_box = _STANDARD_PRESSURE * impedance / highest - impedance
        idle_impedance = self.peak_speed / (idle * self.stroke / 360.0)
        self.throttle = idle_impedance * (_STANDARD_PRESSURE / lowest - 1.0) - self.air_box

    def pressure_ratio(self, throttle: Any, piston_speed: Any) -> Any:
        """Return the ratio of the pressure behind the throttle to the ram pressure."""
        # It increases beyond full throttle too, so that a trim search has a descent direction.
        impedance = self.peak_speed / ca.fmax(piston_speed, _SLOWEST)
        closed = (1.0 - throttle) * ca.fabs(1.0 - throttle)
        return impedance / (impedance + self.air_box + closed * self.throttle)


def _own_consumption(engine: Element, breathing: _Breathing) -> float:
    """Return the specific fuel consumption, lb/(hp h), from the engine's file or rated power."""
    stated = engine.value_of("bsfc", -1.0, "LBS/HP*HR")
    if stated >= 0.0:
        return stated
    # Fuel flow at full throttle over the indicated power, with JSBSim's formula and numbers.
    displacement = engine.value_of("displacement", 360.0, "IN3")
    efficiency = engine.value_of("volumetric-efficiency", 0.85)
    pumping = (29.92 - breathing.highest_inhg) * _INHG_TO_PA * efficiency
    friction = engine.value_of("dynamic-fmep", 18400.0, "PA") * breathing.rated_speed * FOOT
    friction += engine.value_of("static-fmep", 46500.0, "PA")
    lost = (pumping + friction) * displacement * _IN3_TO_M3 * breathing.fastest
    lost /= engine.value_of("cycles", 4.0) * 22371
    flow = 1.1 * displacement * breathing.fastest * efficiency * breathing.highest_inhg / 29.92
    power = engine.value_of("maxhp", 200.0, "HP") + lost
    return flow / (9411 * (power - engine.value_of("static-friction", 1.5, "HP")))


def _mixture_efficiency(mounted: MountedEngine, fuel_share: Any) -> Any:
    """Return the fraction of the power that is available at a fuel-air ratio."""
    for table in mounted.engine.all("table"):
        if table.attributes.get("name") == "MIXTURE":
            return internal_table(table, mounted.properties, [fuel_share])
    shares, efficiencies = _MIXTURE
    return mounted.properties.interpolate(efficiencies, [shares], [fuel_share])


def _boosted(mounted: MountedEngine, throttled: Any, ambient: Any, speed: Any) -> Any:
    """Return the manifold pressure behind the supercharger, Pa, `throttled` without one."""
    # throttled, ambient: pressures behind the throttle and of the air, Pa
    # speed: speed of the engine, rpm
    gears = _gears(mounted.engine)
    if not gears:
        return throttled
    engine = mounted.engine
    override = int(engine.value_of("boostoverride", 0.0)) == 1
    takeoff = engine.value_of("takeoffboost", 0.0, "PSI")
    first_boost = engine.value_of("ratedboost1", 0.0, "PSI")
    throttle = mounted.throttle

    # Manifold pressure in each gear, limited by the boost control.
    manifolds = []
    for gear in gears:
        manifold = throttled * ((gear.multiplier - 1.0) / gear.rated_speed * speed + 1.0)
        if not override:
            cap: Any = gear.rated_pressure
            if takeoff > first_boost:
                at_takeoff = gear.rated_pressure + (takeoff - first_boost) * _PSI_TO_PA
                cap = ca.if_else(throttle > 0.98, at_takeoff, cap)  # 0.98 as in JSBSim
            manifold = ca.fmin(manifold, cap)
        manifolds.append(manifold)

    # The boost lever selects the gear if boostmanual is 1, otherwise the ambient pressure does.
    if int(engine.value_of("boostmanual", 0.0)) == 1:
        chosen = ca.SX(mounted.own("boost-speed", 0.0))  # 0 to 1: the first gear
        result = manifolds[-1]
        for number in range(len(manifolds) - 2, -1, -1):
            result = ca.if_else(chosen < number + 1, manifolds[number], result)
        return result
    result = manifolds[0]
    for number in range(1, len(manifolds)):
        switch = gears[number - 1].switch_pressure  # JSBSim changes gear 1000 Pa below it
        result = ca.if_else(ambient < switch - 1000.0, manifolds[number], result)
    return result


class _Gear(NamedTuple):
    """Gear of a supercharger: factor on the pressure at the rated speed, rpm, the largest manifold
    pressure, Pa, and the ambient pressure, Pa, 1000 Pa below which the next gear is used.
    """

    multiplier: float
    rated_speed: float
    rated_pressure: float
    switch_pressure: float


#: Gear without boost, which JSBSim has in place of an invalid one.
_INVALID_GEAR = _Gear(1.0, 2500.0, 100000.0, 0.0)


def _gears(engine: Element) -> list[_Gear]:
    """Return the gears of a supercharger, or an empty list without one."""
    # As in JSBSim, all gears from an invalid one on are `_INVALID_GEAR`, and one less in number.
    count = int(engine.value_of("numboostspeeds", 0.0))
    gears: list[_Gear] = []
    last_altitude = 0.0
    for number in range(1, count + 1):
        boost = engine.value_of(f"ratedboost{number}", 0.0, "PSI")
        power = engine.value_of(f"ratedpower{number}", 0.0, "HP")
        altitude = engine.value_of(f"ratedaltitude{number}", 0.0, "FT")
        if boost <= 0.0 or power <= 0.0 or altitude < last_altitude:
            return gears + [_INVALID_GEAR] * (count - number)
        rated_pressure = _STANDARD_PRESSURE + boost * _PSI_TO_PA
        multiplier = rated_pressure / (_standard_pressure(altitude) * _PSF_TO_PA)
        rated_speed = engine.value_of(f"ratedrpm{number}", 2500.0)
        switch = 0.0
        if number < count:  # 1000 ft above the rated altitude
            switch = _standard_pressure(altitude + 1000.0 if altitude > 0.0 else 0.0) * _PSF_TO_PA
        gears.append(_Gear(multiplier, rated_speed, rated_pressure, switch))
        last_altitude = altitude
    return gears


def _standard_pressure(altitude: float) -> float:
    """Return the pressure of the standard atmosphere, lb/ft² (`FGPiston::GetStdPressure100K`)."""
    factors = (2116.217, -7.648932746e-2, 1.0925498604e-6, -7.1135726027e-12, 1.7470331356e-17)
    return sum(factor * altitude**power for power, factor in enumerate(factors))


def _boost_loss(engine: Element, throttled: Any, manifold: Any, volume_flow: Any) -> Any:
    """Return the power consumed by the supercharger, hp."""
    # That of isentropic compression times a factor, with JSBSim's ratio of the specific heats.
    factor = engine.value_of("boost-loss-factor", 0.0)
    if factor <= 0.0:
        return 0.0
    ratio = 1.414
    compression = (manifold / throttled) ** ((ratio - 1.0) / ratio) - 1.0
    return throttled * volume_flow * ratio / (ratio - 1.0) * compression * factor / 745.7  # W to hp


#: Fraction of the remaining angle by which the blades feather in each of JSBSim's frames.
_FEATHERING = 1.0 / 300.0


def propeller_effect(mounted: MountedEngine, power: Any) -> Effect:
    """Return the force, moment and power of a propeller, as an `Effect`.

    C_T and C_P are tables over J = V / (n D) and the blade angle. The thrust is C_T ρ n² D⁴, and
    the absorbed power is C_P ρ n³ D⁵. An engine at rest absorbs no power (`FGPiston::Calculate`).

    power: power of the engine, ft lb/s
    """
    prop = mounted.thruster
    power = ca.if_else(mounted.rpm > 0.1, power, ca.fmax(power, 0.0))
    diameter = max(prop.value_of("diameter", 0.001, "FT"), 0.001)
    axes, location = orientation(mounted), thruster_location(mounted)
    flow = _flow(mounted, axes, location, diameter)

    # Thrust and absorbed power.
    blade, blade_rates = _blade(mounted)
    thrust_coefficient = _coefficient(mounted, "C_THRUST", flow, blade)
    power_coefficient = _coefficient(mounted, "C_POWER", flow, blade)
    density, turns = mounted.motion.air.density, flow.turns
    thrust = thrust_coefficient * turns**2 * diameter**4 * density
    absorbed = power_coefficient * turns**3 * diameter**5 * density
    induced = _induced_velocity(flow.velocity[0], thrust, density, diameter)

    # Moments: gyroscopic, and the reaction to the torque of the engine.
    inertia = max(prop.value_of("ixx", 1e-6, "SLUG*FT2"), 1e-6)
    omega = ca.fmax(2.0 * math.pi * turns, 0.01)
    sense = 1.0 if mounted.thruster_mount.value_of("sense", 1.0) >= 0.0 else -1.0
    # As in JSBSim, the sign of the gyroscopic moment depends on the version of the file.
    version = float(prop.attributes.get("version", "0") or "0")
    momentum = inertia * omega * sense * (-1.0 if version > 1.0 else 1.0)
    gyroscopic = ca.cross(mounted.motion.rates, axes[:, 0] * momentum)
    own_moment = gyroscopic - axes[:, 0] * sense * power / omega
    acting = _acting_location(mounted, location, flow.velocity, induced, sense)
    force, moment = thrust_force_and_moment(mounted, thrust, acting, own_moment)

    # Acceleration, rpm/s.
    speed_rate = (power - absorbed) / omega / inertia * 30.0 / math.pi
    rpm = mounted.propeller_rpm
    # The propeller does not turn backwards: at rest, a braking torque has no effect.
    speed_rate = ca.if_else(rpm + speed_rate * STEP > 0.0, speed_rate, -rpm / STEP)
    return Effect(
        force,
        moment,
        thrust,
        power=power / HP,
        rates={f"rpm{mounted.number}": speed_rate, **blade_rates},
        properties={
            "thrust-coefficient": thrust_coefficient,
            "advance-ratio": flow.advance,
            "prop-induced-velocity_fps": induced,
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


def _flow(mounted: MountedEngine, axes: ca.SX, location: ca.SX, diameter: float) -> _Flow:
    """Return the airflow at a propeller with these axes, location and diameter, ft."""
    motion = mounted.motion
    at_propeller = motion.air_velocity + ca.cross(motion.rates, mounted.body.mass.arm(location))
    velocity = ca.mtimes(axes.T, at_propeller)
    turns = mounted.propeller_rpm / 60.0
    advance = velocity[0] / (diameter * ca.fmax(turns, 0.01))
    tip_speed = ca.sqrt((turns * diameter * math.pi) ** 2 + velocity[0] ** 2)
    return _Flow(velocity, turns, advance, tip_speed / motion.air.sound)


def _blade(mounted: MountedEngine) -> tuple[Any, dict[str, Any]]:
    """Return the blade angle of a propeller, deg, and {state: rate}, empty without a governor."""
    # A governor changes the angle by 1 deg/s for each rpm above the commanded speed. If the
    # propeller is feathered, the angle approaches `maxpitch`, by the share `_FEATHERING` of the
    # remaining difference in each frame. A step that would exceed a limit of the angle ends at the
    # limit.
    prop = mounted.thruster
    lowest = prop.value_of("minpitch", 0.0)
    highest = prop.value_of("maxpitch", 0.0)
    if not mounted.governed:
        return mounted.own("blade-angle", lowest), {}
    blade = getattr(mounted.states, f"blade{mounted.number}")
    slowest = prop.value_of("minrpm", 0.0)
    advance: Any = 0.0
    feather: Any = 0.0
    if mounted.kind != "turbine_engine":  # `FGTurbine` does not pass on the levers
        advance = mounted.read(f"fcs/advance-pos-norm[{mounted.number}]")
        feather = mounted.read(f"fcs/feather-pos-norm[{mounted.number}]")
    wanted = slowest + (prop.value_of("maxrpm", 0.0) - slowest) * advance
    governed_rate = mounted.propeller_rpm - wanted
    feathering_rate = (highest - blade) * _FEATHERING / STEP
    rate = ca.if_else(ca.SX(feather) > 0.5, feathering_rate, governed_rate)
    next_blade = ca.fmin(ca.fmax(blade + rate * STEP, lowest), highest)
    return blade, {f"blade{mounted.number}": (next_blade - blade) / STEP}


def _coefficient(mounted: MountedEngine, name: str, flow: _Flow, blade: Any) -> Any:
    """Return C_T or C_P of a propeller, by the name of its table, with factor and Mach correction.

    blade: blade angle, deg, an argument of the table unless it is fixed
    """
    prop = mounted.thruster
    tables = {table.attributes.get("name", ""): table for table in prop.all("table")}
    if name not in tables:
        raise prop.error(f"the propeller has no table {name}; add this table")
    fixed = prop.value_of("minpitch", 0.0) == prop.value_of("maxpitch", 0.0)
    arguments = [flow.advance] if fixed else [flow.advance, blade]
    value = internal_table(tables[name], mounted.properties, arguments)
    factor, mach = ("ct_factor", "CT_MACH") if name == "C_THRUST" else ("cp_factor", "CP_MACH")
    value = value * prop.value_of(factor, 1.0)
    if mach in tables:
        value = value * internal_table(tables[mach], mounted.properties, [flow.tip_mach])
    return value


def _induced_velocity(speed: Any, thrust: Any, density: Any, diameter: float) -> Any:
    """Return the induced velocity w of momentum theory, ft/s: w = (-V + √(V² + 2 T / (ρ A))) / 2.

    speed: axial velocity V, ft/s; its sign, and that of the root's argument, is kept as in JSBSim
    """
    area = 0.25 * math.pi * diameter**2
    squared = speed * ca.fabs(speed) + 2.0 * thrust / (density * area)
    root = ca.sqrt(ca.fmax(ca.fabs(squared), 1e-12))
    return 0.5 * (-speed + ca.if_else(squared > 0.0, root, -root))


def _acting_location(
    mounted: MountedEngine, location: ca.SX, local: Any, induced: Any, sense: float
) -> Any:
    """Return the point where the thrust acts, inches, moved with the flow angle by the P-factor."""
    # local: velocity of the propeller in the air, in the thruster's axes, (3,)
    factor = mounted.thruster_mount.value_of("p_factor", 0.0)
    if factor <= 0.0001:
        return location
    across = ca.sqrt(ca.fmax(local[1] ** 2 + local[2] ** 2, 1e-8))  # not 0: a divisor
    shift = sense * factor * ca.atan2(across, local[0] + induced) / across
    # A flow from below moves the point to the side, and a flow from the side up or down.
    return location + ca.vertcat(0.0, shift * local[2], shift * local[1])


#: Properties that engines set, except the speeds of their shafts.
_COMPUTED = (
    *("thrust-lbs", "power-hp", "map-inhg", "map-pa", "thrust-coefficient", "advance-ratio"),
    *("prop-induced-velocity_fps",),
)


def engine_effect(mounted: MountedEngine) -> Effect:
    """Return the `Effect` of an engine, with the time derivative of its lag.

    Raises BadInputError if the engine's values cause an arithmetic error.
    """
    try:
        effect = _effect_without_lag(mounted)
        effect.rates |= lag_rates(mounted)
        return effect
    except ArithmeticError as error:
        fault = f"the engine's values cause an arithmetic error ({error}); correct this engine"
        raise mounted.engine.error(fault) from error


def _effect_without_lag(mounted: MountedEngine) -> Effect:
    """Return the `Effect` of an engine, without the rates of `lag_rates`."""
    # A propeller requires a power, ft lb/s, and a jet a thrust, lb. As in JSBSim, the number of an
    # engine that does not match its thruster is used in the other unit.
    thruster_effect = propeller_effect if mounted.has_propeller else jet
    if mounted.kind == "turbine_engine":
        return thruster_effect(mounted, turbine_thrust(mounted))
    if mounted.kind == "rocket_engine":
        return jet(mounted, rocket_thrust(mounted))
    if mounted.kind == "turboprop_engine":
        return thruster_effect(mounted, turboprop_power(mounted) * HP)
    if mounted.kind == "electric_engine":
        return thruster_effect(mounted, electric_power(mounted) * HP)
    piston = piston_power(mounted)
    effect = thruster_effect(mounted, piston.horsepower * HP)
    effect.properties |= piston.properties
    effect.rates |= piston.rates
    return effect


def add_engine(mounted: MountedEngine) -> Writer:
    """Define the properties of an engine and return the writer whose value is its `Effect`."""
    properties = mounted.properties
    writer = Writer(partial(engine_effect, mounted), mounted.mount.where)
    properties.add_writer(mounted.full_name("effect"), writer)

    def part(name: str) -> Any:
        """Return the value of a property that the engine sets."""
        effect = properties.value_of(writer, mounted.full_name(name), mounted.mount.where)
        if isinstance(effect, ca.SX):  # unknown, in a loop
            return effect
        if name == "thrust-lbs":
            return effect.thrust
        if name == "power-hp":
            return 0.0 if effect.power is None else effect.power
        return effect.properties.get(name, 0.0)

    for name in _COMPUTED:
        full_name = mounted.full_name(name)
        if properties.writer(full_name) is None:  # unless the file writes this property itself
            properties.add_writer(full_name, Writer(partial(part, name), mounted.mount.where))
    set_running = Writer(partial(running, mounted), mounted.mount.where, BEFORE_ALL)
    properties.add_writer(mounted.full_name("set-running"), set_running)
    properties.define_initial(mounted.full_name("reverser-angle-rad"), 0.0)
    if mounted.has_propeller:
        properties.define(mounted.full_name("propeller-rpm"), mounted.propeller_rpm)
        properties.define(mounted.full_name("engine-rpm"), mounted.rpm)
    if mounted.kind == "turbine_engine":
        _add_shafts(mounted)
        bleed = mounted.full_name("bleed-factor")
        properties.define_initial(bleed, mounted.engine.value_of("bleed", 0.0))
    return writer


def _add_shafts(mounted: MountedEngine) -> None:
    """Define the properties n1 and n2, the speeds of a turbine's shafts, %."""
    # Reading n1 raises BadInputError if the speed n2 is a state.
    for name in ("n1", "n2"):

        def speed(name: str = name) -> Any:
            """Return the speed of the shaft of this name."""
            state = mounted.lag_state
            if state is None:
                on = commanded_speed(mounted, name)
                return ca.if_else(running(mounted), on, windmilling_speed(mounted, name))
            if name == "n1":
                raise mounted.mount.error(
                    "n1 is read, but is not a state of the model; remove engines=states from the "
                    "name of the aircraft"
                )
            return state

        mounted.properties.add_writer(mounted.full_name(name), Writer(speed, mounted.mount.where))
