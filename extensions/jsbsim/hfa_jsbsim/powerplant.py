"""Force, moment and power of an engine together with its thruster, and the properties it sets."""

from __future__ import annotations

from functools import partial
from typing import Any

import casadi as ca

from hfa_jsbsim.engines import (
    HP,
    Effect,
    EngineFile,
    HostAircraft,
    commanded_speed,
    electric_power,
    engine_rpm,
    jet,
    lag_rates,
    lag_state,
    rocket_thrust,
    running,
    turbine_thrust,
    turboprop_power,
    windmilling_speed,
)
from hfa_jsbsim.piston import piston_power
from hfa_jsbsim.propeller import propeller_effect
from hfa_jsbsim.properties import BEFORE_ALL, Writer

#: Properties that engines set, except the speeds of their shafts.
_COMPUTED = (
    *("thrust-lbs", "power-hp", "map-inhg", "map-pa", "thrust-coefficient", "advance-ratio"),
    *("prop-induced-velocity_fps", "helical-tip-Mach", "propeller-torque-ftlb"),
)


def engine_effect(file: EngineFile, aircraft: HostAircraft) -> Effect:
    """Return the `Effect` of an engine, with the time derivative of its lag.

    Raises BadInputError if the engine's values cause an arithmetic error.
    """
    try:
        effect = _effect_without_lag(file, aircraft)
        effect.rates |= lag_rates(file, aircraft)
        return effect
    except ArithmeticError as error:
        fault = f"the engine's values cause an arithmetic error ({error}); correct this engine"
        raise file.engine.error(fault) from error


def _effect_without_lag(file: EngineFile, aircraft: HostAircraft) -> Effect:
    """Return the `Effect` of an engine, without the rates of `lag_rates`."""
    drive = propeller_effect if file.has_propeller else jet
    if file.kind == "turbine_engine":
        # For a propeller, its lb are interpreted as ft lb/s.
        return drive(file, aircraft, turbine_thrust(file, aircraft))
    if file.kind == "rocket_engine":
        return jet(file, aircraft, rocket_thrust(file, aircraft))
    if file.kind == "turboprop_engine":
        return drive(file, aircraft, turboprop_power(file, aircraft) * HP)
    if file.kind == "electric_engine":
        return drive(file, aircraft, electric_power(file, aircraft) * HP)
    piston = piston_power(file, aircraft)
    effect = drive(file, aircraft, piston.horsepower * HP)
    effect.properties |= piston.properties
    effect.rates |= piston.rates
    return effect


def add_engine(file: EngineFile, aircraft: HostAircraft) -> Writer:
    """Define the properties of an engine and return the writer whose value is its `Effect`."""
    properties = aircraft.properties
    writer = Writer(partial(engine_effect, file, aircraft), file.mount.where)

    def part(name: str) -> Any:
        """Return the value of a property that the engine sets."""
        effect = properties.value_of(writer, file.full_name(name), file.mount.where)
        if name == "thrust-lbs":
            return effect.thrust
        if name == "power-hp":
            return 0.0 if effect.power is None else effect.power
        return effect.properties.get(name, 0.0)

    for name in _COMPUTED:
        full_name = file.full_name(name)
        if properties.writer(full_name) is None:
            properties.add_writer(full_name, Writer(partial(part, name), file.mount.where))
    set_running = Writer(partial(running, file, aircraft), file.mount.where, BEFORE_ALL)
    properties.add_writer(file.full_name("set-running"), set_running)
    properties.define_initial(file.full_name("reverser-angle-rad"), 0.0)
    for axis, place in zip("xyz", file.location, strict=True):
        properties.define_initial(file.full_name(f"{axis}-position"), place)
        properties.define_initial(file.full_name(f"{axis}-reference-position"), place)
    if file.has_propeller:
        speed = getattr(aircraft.states, f"rpm{file.number}")
        properties.define(file.full_name("propeller-rpm"), speed)
        properties.define(file.full_name("engine-rpm"), engine_rpm(file, aircraft))
        properties.define(
            file.full_name("propeller-sense"), file.thruster_mount.value_of("sense", 1.0)
        )
    if file.kind == "turbine_engine":
        _add_shafts(file, aircraft)
        bleed = file.full_name("bleed-factor")
        properties.define_initial(bleed, file.engine.value_of("bleed", 0.0))
    return writer


def _add_shafts(file: EngineFile, aircraft: HostAircraft) -> None:
    """Define the properties n1 and n2, the speeds of a turbine's shafts, %.

    Reading n1 raises BadInputError if the speed n2 is a state.
    """
    for name in ("n1", "n2"):

        def speed(name: str = name) -> Any:
            state = lag_state(file, aircraft)
            if state is None:
                on = commanded_speed(file, aircraft, name)
                return ca.if_else(
                    running(file, aircraft), on, windmilling_speed(file, aircraft, name)
                )
            if name == "n1":
                raise file.mount.error(
                    "n1 is read, but is not a state of the model; remove engines=states from the "
                    "name of the aircraft"
                )
            return state

        aircraft.properties.add_writer(file.full_name(name), Writer(speed, file.mount.where))
