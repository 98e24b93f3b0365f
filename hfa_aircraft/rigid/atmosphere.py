"""The U.S. Standard Atmosphere 1976 up to 47 km, in ft, slug, lbf and degrees Rankine.

The constants are those of JSBSim (`FGStandardAtmosphere`). Results agree with JSBSim within
rounding, and within 2e-5 with `hfa_model.atmosphere`, whose constants are the standard's.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from itertools import pairwise
from typing import Any

import casadi as ca
import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import AIRSPEEDS, ISA, recognized
from hfa_support.errors import BadInputError
from hfa_support.units import (
    EARTH_RADIUS,
    FOOT,
    KNOT,
    STANDARD_GRAVITY,
    conversion_factor,
    si_factor,
)

#: Ratio of specific heats of air.
HEAT_RATIO = 1.4
_GRAVITY = STANDARD_GRAVITY / FOOT
_EARTH_RADIUS = EARTH_RADIUS / FOOT
#: Gas constant of air, J/(kg K), and in ft lbf/(slug °R).
GAS_CONSTANT = 8.31432 / 28.9645e-3
_GAS_CONSTANT = GAS_CONSTANT / FOOT / FOOT / 1.8
#: lbf/ft².
SEA_LEVEL_PRESSURE = 2116.228
#: Lowest and highest altitude of aircraft, ft.
ALTITUDES = (-1000.0, 150000.0)
_SEA_LEVEL_TEMPERATURE = 518.67
#: Lower ends of the layers: geopotential altitude, ft, and temperature, degrees Rankine.
_LAYERS = (
    (0.0, _SEA_LEVEL_TEMPERATURE),
    (36089.2388, 389.97),
    (65616.7979, 389.97),
    (104986.8766, 411.57),
    (154199.4751, 487.17),
)


@dataclass(frozen=True)
class Air:
    """State of the air, in ft, slug, lbf and degrees Rankine, or in SI units.

    temperature: degrees Rankine or K.
    pressure: static pressure.
    density: density.
    sound: speed of sound.
    """

    temperature: Any
    pressure: Any
    density: Any
    sound: Any


def air_at(altitude: Any, system: str, warmer: Any = 0.0) -> Air:
    """Return standard air at a geometric altitude, in ft or m, of at most 154,000 ft.

    system: system of units, english or si
    warmer: deviation of the temperature, K. The pressure is that of the standard at the altitude,
        which then is a pressure altitude.
    """
    if system == "si":
        english = air_at(altitude / FOOT, "english", warmer)
        return Air(
            english.temperature / 1.8,
            english.pressure * si_factor("lbf/ft^2"),
            english.density * si_factor("slug/ft^3"),
            english.sound * FOOT,
        )
    if isinstance(altitude, int | float):
        # the formula of a layer gives a complex Python number outside it, in CasADi nan
        altitude = ca.DM(altitude)
    height = altitude * _EARTH_RADIUS / (_EARTH_RADIUS + altitude)  # geopotential altitude
    base_pressure = SEA_LEVEL_PRESSURE
    temperature: Any = 0.0
    pressure: Any = 0.0
    for (bottom, base_temperature), (top, top_temperature) in pairwise(_LAYERS):
        lapse = (top_temperature - base_temperature) / (top - bottom)
        layer_temperature = base_temperature + lapse * (height - bottom)
        layer_pressure = base_pressure * _pressure_ratio(base_temperature, lapse, height - bottom)
        if bottom:
            temperature = ca.if_else(height < bottom, temperature, layer_temperature)
            pressure = ca.if_else(height < bottom, pressure, layer_pressure)
        else:
            temperature = layer_temperature
            pressure = layer_pressure
        base_pressure = float(
            base_pressure * _pressure_ratio(base_temperature, lapse, top - bottom)
        )
    temperature = temperature + 1.8 * warmer  # degrees Rankine
    sound = ca.sqrt(HEAT_RATIO * _GAS_CONSTANT * temperature)
    return Air(temperature, pressure, pressure / (_GAS_CONSTANT * temperature), sound)


def density_altitude(density: Any) -> Any:
    """Return the geometric altitude, ft, at which standard air has a density, slug/ft³.

    In a layer with lapse rate L, ρ/ρ_bottom = (T_bottom / T)^(1 + g/(R L)), or for L = 0
    exp(-g climb / (R T)), from which the climb above its bottom follows.
    """
    height: Any = 0.0  # geopotential altitude
    base_pressure = SEA_LEVEL_PRESSURE
    for (bottom, base_temperature), (top, top_temperature) in pairwise(_LAYERS):
        lapse = (top_temperature - base_temperature) / (top - bottom)
        base_density = base_pressure / (_GAS_CONSTANT * base_temperature)
        if lapse:
            exponent = 1.0 / (1.0 + _GRAVITY / (_GAS_CONSTANT * lapse))
            climb = base_temperature / lapse * ((base_density / density) ** exponent - 1.0)
        else:
            climb = _GAS_CONSTANT * base_temperature / _GRAVITY * ca.log(base_density / density)
        height = ca.if_else(density < base_density, bottom + climb, height) if bottom else climb
        base_pressure = float(
            base_pressure * _pressure_ratio(base_temperature, lapse, top - bottom)
        )
    # from geopotential to geometric altitude
    return height * _EARTH_RADIUS / (_EARTH_RADIUS - height)


def equivalent_airspeed(dynamic_pressure: float) -> float:
    """Return the equivalent airspeed sqrt(2 q / ρ0), kt.

    dynamic_pressure: q = ρ V²/2, Pa
    """
    return math.sqrt(2.0 * dynamic_pressure / float(air_at(0.0, "si").density)) / KNOT


def pitot_pressure(mach: Any, pressure: Any) -> Any:
    """Return the total pressure in a pitot tube, in the unit of `pressure`.

    The flow is isentropic below Mach 1. Rayleigh's formula applies from Mach 1 on.

    pressure: static pressure
    """
    coefficient = 1.2**3.5 * 6.0**2.5
    fast = ca.fmax(mach, 1.0)
    supersonic = coefficient * fast**7.0 / (7.0 * fast * fast - 1.0) ** 2.5
    return pressure * ca.if_else(mach < 1.0, (1.0 + 0.2 * mach * mach) ** 3.5, supersonic)


def mach_of_impact(impact_pressure: Any, pressure: Any) -> Any:
    """Return the Mach number from the impact pressure: the inverse of `pitot_pressure`.

    impact_pressure: total minus static pressure
    pressure: static pressure
    """
    ratio = impact_pressure / pressure + 1.0
    subsonic = ca.sqrt(5.0 * (ratio ** (2.0 / 7.0) - 1.0))  # isentropic flow
    # Rayleigh's formula as ratio = 1.2^3.5 (1.2/1.4)^2.5 M² / (1 - 1/(7 M²))^2.5 is solved for the
    # first M², with the second from the last iteration. Both formulas give M = 1 at the same ratio.
    coefficient = 1.2 ** (-0.25 * 7.0) * (1.2 / 1.4) ** (-0.5 * 2.5)
    supersonic = ca.fmax(subsonic, 1.0)
    for _ in range(10):  # as many fixed-point iterations as JSBSim's
        supersonic = coefficient * ca.sqrt(ratio * (1.0 - 1.0 / (7.0 * supersonic**2)) ** 2.5)
    return ca.if_else(subsonic > 1.0, supersonic, subsonic)


def calibrated_speed(mach: Any, pressure: Any) -> Any:
    """Return the calibrated airspeed at a Mach number, ft/s.

    At sea level, this airspeed has the same impact pressure.

    pressure: static pressure, lbf/ft²
    """
    impact = pitot_pressure(mach, pressure) - pressure
    return SEA_LEVEL.sound * mach_of_impact(impact, SEA_LEVEL_PRESSURE)


def calibrated_airspeed(dynamic_pressure: float, mach: float) -> float:
    """Return the calibrated airspeed, kt, at the static pressure p = 2 q / (1.4 M²).

    q = ρ V²/2 and M² = ρ V² / (1.4 p).

    dynamic_pressure: q = ρ V²/2, Pa
    mach: Mach number M
    """
    pressure = 2.0 * dynamic_pressure / (HEAT_RATIO * mach**2) / si_factor("lbf/ft^2")
    return float(calibrated_speed(ca.DM(mach), pressure)) * FOOT / KNOT


def _pressure_ratio(base_temperature: float, lapse: float, climb: Any) -> Any:
    """Return the pressure in a layer of the atmosphere, relative to the pressure at its bottom."""
    if lapse == 0.0:
        return ca.exp(-_GRAVITY * climb / (_GAS_CONSTANT * base_temperature))
    return (base_temperature / (base_temperature + lapse * climb)) ** (
        _GRAVITY / (_GAS_CONSTANT * lapse)
    )


SEA_LEVEL = Air(
    _SEA_LEVEL_TEMPERATURE,
    SEA_LEVEL_PRESSURE,
    SEA_LEVEL_PRESSURE / (_GAS_CONSTANT * _SEA_LEVEL_TEMPERATURE),
    math.sqrt(HEAT_RATIO * _GAS_CONSTANT * _SEA_LEVEL_TEMPERATURE),
)


#: ft/s.
_KNOT = KNOT / FOOT
#: Accuracy of a crossover altitude, relative to that of all altitudes: a nanometre.
_CROSSOVER_ACCURACY = 1e-14
#: Outputs from which the air of a model follows, with their units here.
_OF_AIR = {"dynamic_pressure": "lbf/ft^2", "mach": "1"}


def with_airspeed(model: Model, imposed: Mapping[str, Any]) -> Model:
    """Return the model for a trim that imposes one airspeed, and no altitude.

    The equations of the result have this airspeed as a further output, which follows from their
    outputs `dynamic_pressure` and `mach`. The model is returned unchanged if it has no such
    outputs, if it has the airspeed as an output, or for any other trim.

    imposed: variable, output, airspeed or parameter -> value
    """
    names = [name for name in model.airspeeds if name in imposed]
    is_needed = len(names) == 1 and names[0] not in model.outputs
    roles = recognized(model.states)
    if not (is_needed and {*_OF_AIR} <= {*model.outputs}) or roles["altitude"] in imposed:
        return model
    (name,) = names
    speed = roles["speed"]
    factors = [_factor_to_model(model, output, unit) for output, unit in _OF_AIR.items()]
    equations = _with_airspeed_output(
        model.equations, name, speed, (*factors, _factor_to_model(model, speed, "kt"))
    )
    return replace(model, equations=equations, outputs={**model.outputs, name: AIRSPEEDS[name]})


@lru_cache(maxsize=16)
def _with_airspeed_output(equations: Any, name: str, speed: str, factors: tuple[float, ...]) -> Any:
    """Return equations with one more output, an airspeed in kt.

    name: name of the airspeed, ktas, keas or kcas
    speed: name of the state that is the true airspeed
    factors: from lbf/ft^2, 1 and kt to the units of dynamic pressure, Mach number and speed
    """

    def with_output(x: Any, u: Any, p: Any, w: Any) -> tuple[Any, dict[str, Any]]:
        """Return rates by state, and outputs by name."""
        rates, outputs = equations(x, u, p, w)
        values = (*(outputs[output] for output in _OF_AIR), getattr(x, speed))
        dynamic_pressure, mach, ktas = (
            value / factor for value, factor in zip(values, factors, strict=True)
        )
        airspeed = ktas
        if name == "keas":
            airspeed = ca.sqrt(2.0 * dynamic_pressure / SEA_LEVEL.density) / _KNOT
        elif name == "kcas":
            static_pressure = 2.0 * dynamic_pressure / (HEAT_RATIO * mach**2)
            airspeed = calibrated_speed(mach, static_pressure) / _KNOT
        return rates, {**outputs, name: airspeed}

    return with_output


def with_speed(model: Model, imposed: Mapping[str, Any]) -> dict[str, Any]:
    """Return the imposed values of a trim, with the state `speed` in place of an airspeed.

    The air at the imposed altitude determines the speed. Without an altitude, two airspeeds
    determine both, such as kcas and mach at a crossover. An airspeed that is an output of the
    model's equations stays imposed if no altitude is imposed or these equations have air of their
    own: the trim then solves for the speed.

    imposed: variable, output, airspeed or parameter -> number, or array of a common length

    Raises BadInputError if a speed is not positive, if two are imposed at an altitude, if two agree
    at no altitude, or if one that is no output is imposed without an altitude.
    """
    names = [name for name in model.airspeeds if name in imposed]
    if not names:
        return dict(imposed)
    roles = recognized(model.states)
    speed, altitude = roles["speed"], roles["altitude"]
    for airspeed in names:
        least = np.min(imposed[airspeed])
        if not least > 0.0:
            raise BadInputError(
                f"{airspeed} is {model.describe(airspeed, least)}; give a positive speed"
            )
    name = names[0]
    if altitude not in imposed:
        if {*names} <= {*model.outputs}:  # the model's equations find the speed and the altitude
            return dict(imposed)
        imposed = _with_crossover(model, names, speed, altitude, imposed)
    elif len(names) > 1 or speed in imposed:  # two speeds at an altitude
        speeds = [*names, speed] if speed in imposed else names
        raise BadInputError(
            f"{' and '.join(speeds[:2])} are both imposed, and each gives the speed at the"
            f" altitude; give one of them, or free {altitude}"
        )
    # The model's equations find the speed, or else the standard atmosphere gives it.
    if name in model.outputs and ISA not in model.parameters:
        return dict(imposed)
    others = {other: imposed[other] for other in imposed if other != name}
    in_ft_per_s = _true_airspeed_of(model, name, altitude, imposed)
    return others | {speed: in_ft_per_s * _factor_to_model(model, speed, "ft/s")}


def _with_crossover(
    model: Model, names: Sequence[str], speed: str, altitude: str, imposed: Mapping[str, Any]
) -> dict[str, Any]:
    """Return the imposed values with the altitude of two airspeeds in place of the second."""
    if len(names) != 2 or speed in imposed:
        raise BadInputError(f"{names[0]} is imposed without an altitude; impose {altitude} too")
    first, second = names
    imposed = {**imposed, altitude: _crossover(model, first, second, altitude, imposed)}
    del imposed[second]
    return imposed


def _crossover(
    model: Model, first: str, second: str, altitude: str, imposed: Mapping[str, Any]
) -> Any:
    """Return the altitude at which two airspeeds are one true airspeed, a number or an array."""
    # The difference of the two speeds grows or falls with altitude, and has one zero at most. That
    # of ktas and mach changes with the temperature only, and may have two: none is found then.
    from scipy.optimize import brentq

    lowest, highest = (height * _factor_to_model(model, altitude, "ft") for height in ALTITUDES)

    def speed_difference(height: float, at_point: Mapping[str, float]) -> float:
        """Return the first minus the second true airspeed, ft/s, at an altitude."""
        there = {**at_point, altitude: height}
        of_first, of_second = (
            _true_airspeed_of(model, name, altitude, there) for name in (first, second)
        )
        return float(of_first - of_second)

    # One search for each point of the imposed arrays
    names = {first, second, *model.parameters} & {*imposed}
    columns = np.broadcast_arrays(*(imposed[name] for name in names))
    heights = []
    for values in zip(*(column.ravel() for column in columns), strict=True):
        at_point = dict(zip(names, map(float, values), strict=True))
        at_lowest, at_highest = (speed_difference(end, at_point) for end in (lowest, highest))
        if at_lowest * at_highest > 0.0:
            words = " and ".join(
                f"{name} {model.describe(name, at_point[name])}" for name in (first, second)
            )
            between = " and ".join(model.describe(altitude, end) for end in (lowest, highest))
            raise BadInputError(
                f"{words} do not give one altitude between {between}; impose {altitude} instead of"
                " one of them"
            )
        accuracy = _CROSSOVER_ACCURACY * (highest - lowest)
        heights.append(brentq(speed_difference, lowest, highest, (at_point,), xtol=accuracy))
    return np.reshape(heights, columns[0].shape) if columns[0].ndim else heights[0]


def _true_airspeed_of(model: Model, name: str, altitude: str, imposed: Mapping[str, Any]) -> Any:
    """Return the true airspeed of an imposed airspeed, ft/s, as a number or an array."""
    start = {parameter: signal.start for parameter, signal in model.parameters.items()}
    # A model has air of its own if its outputs show this air and it has no parameter ISA, which
    # belongs to standard air.
    if ISA in model.parameters or not {*_OF_AIR} <= {*model.outputs}:
        height = imposed[altitude] / _factor_to_model(model, altitude, "ft")
        return _evaluated(
            _in_standard_air(name), imposed[name], height, imposed.get(ISA, start.get(ISA, 0.0))
        )
    p = [imposed.get(parameter, value) for parameter, value in start.items()]
    function = _in_own_air(model, name, altitude)
    return _evaluated(function, imposed[name], imposed[altitude], *p)


def _factor_to_model(model: Model, name: str, unit: str) -> float:
    """Return the factor from a unit to that of a signal of a model."""
    factor = conversion_factor(unit, model.unit(name))
    if factor is None:
        raise BadInputError(f"{name} is in {model.unit(name)}; declare it in {unit}")
    return factor


def _evaluated(function: ca.Function, *arguments: Any) -> Any:
    """Return the value of a function of scalars: a number for numbers, an array for arrays (N,)."""
    rows = np.broadcast_arrays(
        *(np.atleast_1d(np.asarray(argument, float)) for argument in arguments)
    )
    found = function.map(rows[0].size)(*(row[None] for row in rows)).full().ravel()
    return float(found[0]) if all(np.ndim(argument) == 0 for argument in arguments) else found


@lru_cache
def _in_standard_air(name: str) -> ca.Function:
    """Return the function (airspeed, altitude in ft, deviation in K) -> true airspeed, ft/s."""
    value, altitude, warmer = ca.SX.sym("value"), ca.SX.sym("altitude"), ca.SX.sym("warmer")
    speed = _true_airspeed(name, value, air_at(altitude, "english", warmer))
    return ca.Function("speed", [value, altitude, warmer], [speed])


@lru_cache(maxsize=16)
def _in_own_air(model: Model, name: str, altitude: str) -> ca.Function:
    """Return the function (airspeed, altitude, *parameters) -> true airspeed, ft/s."""
    # Air density and speed of sound follow from dynamic pressure and Mach number at any one speed,
    # here the nominal speed.
    speed = recognized(model.states)["speed"]
    airspeed, height, *p = (ca.SX.sym(symbol) for symbol in (name, altitude, *model.parameters))
    start: dict[str, Any] = {
        variable: model.signals[variable].start for variable in (*model.states, *model.inputs)
    }
    start |= {altitude: height, speed: model.signals[speed].nominal}
    x, u = ([start[variable] for variable in group] for group in (model.states, model.inputs))
    _, outputs = model.layout.expressions((x, u, p), tuple(_OF_AIR))
    dynamic_pressure, mach = (
        output / _factor_to_model(model, output_name, unit)
        for output, (output_name, unit) in zip(ca.vertsplit(outputs), _OF_AIR.items(), strict=True)
    )
    nominal_speed = start[speed] / _factor_to_model(model, speed, "ft/s")
    density, sound = 2.0 * dynamic_pressure / nominal_speed**2, nominal_speed / mach
    static_pressure = density * sound**2 / HEAT_RATIO
    air = Air(None, static_pressure, density, sound)  # airspeeds do not require the temperature
    return ca.Function("speed", [airspeed, height, *p], [_true_airspeed(name, airspeed, air)])


def _true_airspeed(name: str, value: Any, air: Air) -> Any:
    """Return the true airspeed, ft/s, of an airspeed in kt or a Mach number."""
    if name == "mach":
        return value * air.sound
    if name == "ktas":
        return value * _KNOT
    if name == "keas":
        return value * _KNOT * ca.sqrt(SEA_LEVEL.density / air.density)
    # kcas: the impact pressure is that of the same speed at sea level
    impact = pitot_pressure(value * _KNOT / SEA_LEVEL.sound, SEA_LEVEL_PRESSURE)
    return mach_of_impact(impact - SEA_LEVEL_PRESSURE, air.pressure) * air.sound
