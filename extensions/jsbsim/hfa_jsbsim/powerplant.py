"""Force, moment and power of an engine together with its thruster."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from hfa_jsbsim import engines as jets
from hfa_jsbsim.engines import HP, Effect, EngineFile, Surroundings
from hfa_jsbsim.piston import piston_power
from hfa_jsbsim.propeller import propeller_effect


def computing(file: EngineFile, around: Surroundings) -> Callable[[], Effect]:
    """Return a function without arguments that computes the `Effect` of an engine.

    The function raises BadInputError if the engine's values cause an arithmetic error.
    """

    def compute() -> Effect:
        try:
            made = effect()
            made.rates |= jets.lag_rates(file, around)
            return made
        except ArithmeticError as error:
            fault = f"the engine's values cause an arithmetic error ({error}); correct this engine"
            raise file.engine.error(fault) from error

    def effect() -> Effect:
        if file.kind == "turbine_engine":
            # For a propeller, its lb are interpreted as ft lb/s.
            power = jets.turbine_thrust(file, around)
            if not file.has_propeller:
                return jets.jet(file, around, power)
            return propeller_effect(file, around, power)
        if file.kind == "rocket_engine":
            return jets.jet(file, around, jets.rocket_thrust(file, around))
        properties: dict[str, Any] = {}
        rates: dict[str, Any] = {}
        if file.kind == "piston_engine":
            horsepower, properties, rates = piston_power(file, around)
        elif file.kind == "turboprop_engine":
            horsepower = jets.turboprop_power(file, around)
        else:
            horsepower = jets.electric_power(file, around)
        drive = propeller_effect if file.has_propeller else jets.jet
        driven = drive(file, around, horsepower * HP)
        driven.properties |= properties
        driven.rates |= rates
        return driven

    return compute
