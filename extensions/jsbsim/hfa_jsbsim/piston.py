"""Piston engines with and without superchargers. Constants are those of `FGPiston`."""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from hfa_jsbsim.engines import (
    EngineFile,
    HostAircraft,
    engine_rpm,
    internal_table,
    lag_state,
    own_property,
    running,
    throttle_of,
)
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


def piston_power(file: EngineFile, aircraft: HostAircraft) -> PistonPower:
    """Return the power of a piston engine.

    It is the indicated power, less the static friction and the power of the supercharger, plus the
    power of the mean pressure p in the cylinders, p V n / cycles, of pumping and friction.
    """
    engine = file.engine
    air = aircraft.motion.air
    ambient = air.pressure * _PSF_TO_PA
    speed = engine_rpm(file, aircraft)
    breathing = _Breathing(engine)
    piston_speed = speed * breathing.stroke / 360.0
    ratio = breathing.pressure_ratio(throttle_of(file, aircraft), piston_speed)
    throttled = _ram_pressure(file, aircraft, ambient) * ratio
    rates = {}
    state = lag_state(file, aircraft)
    if state is not None:
        delay = engine.value_of("man-press-lag", 1.0)
        rates[file.lag] = (throttled / _INHG_TO_PA - state) / delay
        throttled = state * _INHG_TO_PA
    manifold = _boosted(file, aircraft, throttled, ambient, speed)
    efficiency = _settable(file, aircraft, "volumetric-efficiency", 0.85)
    displacement = engine.value_of("displacement", 360.0, "IN3") * _IN3_TO_M3
    swept = displacement * (speed / 60.0) / 2.0
    volume_flow = swept * efficiency * _exhaust_factor(engine, ambient, manifold)
    air_flow = volume_flow * manifold / (_GAS_CONSTANT * (air.temperature / 1.8))
    own_friction = engine.value_of("static-friction", 1.5, "HP")
    static_friction = own_property(file, aircraft, "friction-hp", own_friction)
    runs = running(file, aircraft)
    of_fuel = _power_of_fuel(file, aircraft, breathing, air_flow)
    indicated = ca.if_else(runs, of_fuel - static_friction, -static_friction)
    # Without ignition the engine is dragged by the propeller.
    friction = ca.if_else(runs, _friction_pressure(engine, piston_speed), 0.0)
    pumping = (throttled - ambient) * efficiency
    cycles = engine.value_of("cycles", 4.0)
    of_pressures = (pumping + friction) * displacement * speed / (cycles * 22371)
    power = indicated + of_pressures - _boost_loss(engine, throttled, manifold, volume_flow)
    return PistonPower(power, {"map-pa": manifold, "map-inhg": manifold / _INHG_TO_PA}, rates)


def _ram_pressure(file: EngineFile, aircraft: HostAircraft, ambient: Any) -> Any:
    """Return the pressure in front of the air box, Pa."""
    total = aircraft.properties.read("propulsion/pt-lbs_sqft", file.mount.where) * _PSF_TO_PA
    return (total - ambient) * _settable(file, aircraft, "ram-air-factor", 1.0) + ambient


def _exhaust_factor(engine: Element, ambient: Any, manifold: Any) -> Any:
    """Return the fraction of the cylinder that exhaust gas leaves free for fresh air."""
    compression = engine.value_of("compression-ratio", 8.5)
    back_ratio = ca.fmin(ambient / ca.fmax(manifold, 1.0), compression)
    return 0.3 / 1.3 + (compression - back_ratio) / (1.3 * (compression - 1.0))


def _power_of_fuel(
    file: EngineFile, aircraft: HostAircraft, breathing: _Breathing, air_flow: Any
) -> Any:
    """Return the power of the fuel that burns with an air flow, kg/s, in hp."""
    where = file.mount.where
    lever = aircraft.properties.read(f"fcs/mixture-cmd-norm[{file.number}]", where)
    mixture = aircraft.properties.read_or(f"fcs/mixture-pos-norm[{file.number}]", lever, where)
    ambient = aircraft.motion.air.pressure * _PSF_TO_PA
    fuel_share = 1.3 * mixture * 101325.0 / ambient / 14.7
    fuel_flow = air_flow * fuel_share * 2.2046 * 3600.0
    power = fuel_flow / _consumption(file, aircraft, breathing)
    return power * _mixture_efficiency(file.engine, aircraft, fuel_share)


def _friction_pressure(engine: Element, piston_speed: Any) -> Any:
    """Return the mean pressure of friction in the cylinders, Pa, negative."""
    dynamic = -engine.value_of("dynamic-fmep", 18400.0, "PA") * piston_speed * FOOT
    return dynamic - engine.value_of("static-fmep", 46500.0, "PA")


def _settable(file: EngineFile, aircraft: HostAircraft, name: str, default: float) -> Any:
    """Return a number of a piston engine, which the engine's file or a system can set."""
    return own_property(file, aircraft, name, file.engine.value_of(name, default))


class _Breathing:
    """Flow resistance of the air box and throttle of a piston engine."""

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


def _consumption(file: EngineFile, aircraft: HostAircraft, breathing: _Breathing) -> Any:
    """Return the brake specific fuel consumption, lb/(hp h)."""
    return own_property(file, aircraft, "bsfc-lbs_hphr", _own_consumption(file.engine, breathing))


def _own_consumption(engine: Element, breathing: _Breathing) -> float:
    """Return the specific fuel consumption, lb/(hp h), from the engine's file or rated power."""
    stated = engine.value_of("bsfc", -1.0, "LBS/HP*HR")
    if stated >= 0.0:
        return stated
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


def _mixture_efficiency(engine: Element, aircraft: HostAircraft, fuel_share: Any) -> Any:
    """Return the fraction of the power that is available at a fuel-air ratio."""
    for table in engine.all("table"):
        if table.attributes.get("name") == "MIXTURE":
            return internal_table(table, aircraft, [fuel_share])
    shares, efficiencies = _MIXTURE
    return aircraft.properties.interpolate(efficiencies, [shares], [fuel_share])


def _boosted(
    file: EngineFile, aircraft: HostAircraft, throttled: Any, ambient: Any, speed: Any
) -> Any:
    """Return the manifold pressure behind the supercharger, Pa, `throttled` without one.

    The gear of the supercharger depends on the ambient pressure, or on the boost lever if
    boostmanual is 1.

    throttled, ambient: pressures behind the throttle and of the air, Pa
    speed: speed of the engine, rpm
    """
    gears = _gears(file.engine)
    if not gears:
        return throttled
    engine = file.engine
    override = int(engine.value_of("boostoverride", 0.0)) == 1
    takeoff = engine.value_of("takeoffboost", 0.0, "PSI")
    first_boost = engine.value_of("ratedboost1", 0.0, "PSI")
    throttle = throttle_of(file, aircraft)
    manifolds = []
    for gear in gears:
        manifold = throttled * ((gear.multiplier - 1.0) / gear.rated_speed * speed + 1.0)
        if not override:
            cap: Any = gear.rated_pressure
            if takeoff > first_boost:
                at_takeoff = gear.rated_pressure + (takeoff - first_boost) * _PSI_TO_PA
                cap = ca.if_else(throttle > 0.98, at_takeoff, cap)
            manifold = ca.fmin(manifold, cap)
        manifolds.append(manifold)
    if int(engine.value_of("boostmanual", 0.0)) == 1:
        chosen = ca.SX(own_property(file, aircraft, "boost-speed", 0.0))
        result = manifolds[-1]
        for number in range(len(manifolds) - 2, -1, -1):
            result = ca.if_else(chosen < number + 1, manifolds[number], result)
        return result
    result = manifolds[0]
    for number in range(1, len(manifolds)):
        switch = gears[number - 1].switch_pressure
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
    """Return the gears of a supercharger, or an empty list without one.

    From an invalid gear on, all are `_INVALID_GEAR`, and their number is reduced by one.
    """
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
        if number < count:
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
    factor = engine.value_of("boost-loss-factor", 0.0)
    if factor <= 0.0:
        return 0.0
    ratio = 1.414
    compression = (manifold / throttled) ** ((ratio - 1.0) / ratio) - 1.0
    return throttled * volume_flow * ratio / (ratio - 1.0) * compression * factor / 745.7
