"""Conversion of a model to SI units, or to coherent units with radians.

The declaration and the equations are converted. All later computations are then in these units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import lru_cache, partial
from typing import Any

import casadi as ca

from hfa_aircraft.about import Domain, Source
from hfa_aircraft.layout import Layout
from hfa_aircraft.model import Model
from hfa_aircraft.signals import AIRSPEEDS, VECTORS, Signal, record
from hfa_support.units import (
    ENGLISH_BASES,
    SI_BASES,
    coherent_unit,
    conversion_factor,
    si_factor,
    si_unit,
)

#: CasADi's operations that require an angle in radians, with their names in Python.
_TRIGONOMETRIC = {ca.OP_SIN: "sin", ca.OP_COS: "cos", ca.OP_TAN: "tan"}
#: CasADi's operations whose result has the unit of their arguments.
_KEEP_THE_UNIT = (ca.OP_ASSIGN, ca.OP_NEG, ca.OP_ADD, ca.OP_SUB)


def notes_on_degrees(model: Model) -> list[str]:
    """Return a warning for each sine, cosine or tangent of a signal in degrees in the equations.

    The equations receive the signal in its declared unit. The angle is therefore wrong by the
    factor 180/π. Sums and differences of signals in degrees are examined too. A signal that the
    equations multiply by a factor is assumed to be converted to radians.
    """
    model = model.native
    names = tuple(name for name, signal in model.signals.items() if signal.unit == "deg")
    if not names:
        return []
    return [
        f"the equations compute the {function} of {name}, which is declared in deg; declare {name} "
        f"in rad (reports show degrees), or convert {name} to rad in the equations"
        for name, function in _angles_in_degrees(model.layout, names)
    ]


@lru_cache(maxsize=16)
def _angles_in_degrees(layout: Layout, names: tuple[str, ...]) -> tuple[tuple[str, str], ...]:
    """Return the signals of which the equations compute a sine, cosine or tangent, (signal, "sin").

    A sum or difference that contains the signal counts too.

    names: signals in degrees
    """
    # The instructions of the compiled equations are followed in their order: `in_degrees` holds
    # which signals in degrees each place in memory contains.
    vectors = layout.symbols("x", "u", "p")
    f, y = layout.expressions(vectors, layout.names.outputs)
    program = ca.Function("equations", vectors, [f, y])
    found: dict[tuple[str, str], None] = {}
    in_degrees: dict[int, tuple[str, ...]] = {}
    for number in range(program.n_instructions()):
        operation = program.instruction_id(number)
        arguments = program.instruction_input(number)
        if operation == ca.OP_OUTPUT:
            continue
        signals: tuple[str, ...] = ()
        if operation == ca.OP_INPUT:
            vector, entry = arguments
            name = layout.names[vector][entry]
            signals = (name,) if name in names else ()
        elif operation in _KEEP_THE_UNIT:
            signals = tuple(name for index in arguments for name in in_degrees.get(index, ()))
        elif operation in _TRIGONOMETRIC:
            for name in in_degrees.get(arguments[0], ()):
                found[name, _TRIGONOMETRIC[operation]] = None
        for result in program.instruction_output(number):
            in_degrees[result] = signals
    return tuple(found)


def in_si(model: Model) -> Model:
    """Return a model with all signals in SI units: meters, kilograms, seconds and radians.

    Words that are no unit of a fixed size (%, rpm, °C) remain, and knots of airspeeds that are
    named by them (kcas). `source.native` of the result is the original model. A model in SI units
    is returned unchanged.
    """
    units = {
        name: signal.unit if name in AIRSPEEDS else si_unit(signal.unit)
        for name, signal in model.signals.items()
    }
    return _with_units(model, units, reload=in_si)


@lru_cache(maxsize=16)
def coherent(model: Model) -> Model:
    """Return a model in radians, seconds and units of one system, as figures of reports require.

    The system is that of feet, slugs and pounds if a unit has feet, and SI otherwise. Signals in
    units of it are unchanged.
    """
    words = " ".join(signal.unit for signal in model.signals.values())
    bases = ENGLISH_BASES if re.search(r"\bft\b", words) else SI_BASES
    units = {name: coherent_unit(signal.unit, bases) for name, signal in model.signals.items()}
    return _with_units(model, units, reload=coherent)


def _with_units(model: Model, units: Mapping[str, str], reload: Callable[[Model], Model]) -> Model:
    """Return a model with all signals in other units, and with rates per second.

    units: name of a signal -> its unit in the result
    reload: the public function that converts, by which pickle makes the result again
    """
    signals = model.signals
    if all(units[name] == signal.unit for name, signal in signals.items()):
        return model
    # A unit that cannot be converted, such as %, is kept: the factor is 1.
    factors = {
        name: conversion_factor(signal.unit, units[name]) or 1 for name, signal in signals.items()
    }
    per_second = conversion_factor(f"1/{model.time_unit}", "1/s") or 1.0
    of_rates = {name: factors[name] * per_second for name in model.states}
    converted = {
        name: _signal_in(units[name], factors[name], signal) for name, signal in signals.items()
    }
    for name, factor in of_rates.items():
        converted[name] = converted[name]._replace(rate=model.rate_scale(name) * factor)
        # The rate that a trim imposes, unless a signal has its name.
        factors.setdefault(f"{name}_dot", factor)

    kinds: dict[str, Any] = {
        kind: {name: converted[name] for name in getattr(model, kind)}
        for kind in (*VECTORS.values(), "outputs")
    }
    begin = model.trimming.begin
    return replace(
        model,
        **kinds,
        equations=partial(_equations, factors, of_rates, model.equations),
        trim=_scaled(factors, model.trim),
        domain=_domain_in(factors, model.domain),
        trimming=replace(model.trimming, begin=begin and partial(_begin, factors, begin)),
        source=Source(model.source.text, model.source.digest, native=model, reload=reload),
    )


def _signal_in(unit: str, factor: float, signal: Signal) -> Signal:
    """Return a signal in another unit."""
    return signal._replace(
        unit=unit,
        nominal=signal.nominal * factor,
        min=signal.min * factor,
        max=signal.max * factor,
        start=signal.start * factor,
    )


def _domain_in(factors: Mapping[str, float], domain: Domain) -> Domain:
    """Return a domain in other units. That of flights is the original model's."""
    return Domain(
        range={
            name: (low * factors[name], high * factors[name], source)
            for name, (low, high, source) in domain.range.items()
        },
        envelope=domain.envelope and partial(_envelope, factors, domain.envelope),
        check=domain.check and partial(_check, factors, domain.check),
        reference=_scaled(factors, domain.reference),
        by_speed=domain.by_speed,
    )


def _scaled(factors: Mapping[str, float], values: Mapping[str, Any]) -> dict[str, Any]:
    """Return name -> converted value. An airspeed without a declared signal is unchanged."""
    return {name: value * factors.get(name, 1.0) for name, value in values.items()}


def _declared(factors: Mapping[str, float], vector: Any) -> Any:
    """Return a named tuple of converted values in the units of the original model."""
    values = zip(vector._fields, vector, strict=True)
    return record(vector._fields)(*(value / factors[name] for name, value in values))


# Functions of a model in converted units; each calls that of the original model.


def _equations(
    factors: Mapping[str, float],
    of_rates: Mapping[str, float],
    equations: Callable[..., Any],
    *vectors: Any,
) -> tuple[dict[str, Any], dict[str, Any]]:
    """Return state -> rate and output -> value of the vectors x, u, p and w."""
    rates, outputs = equations(*(_declared(factors, vector) for vector in vectors))
    return _scaled(of_rates, rates), _scaled(factors, outputs)


def _envelope(
    factors: Mapping[str, float], envelope: Callable[..., Mapping[str, Any]], x: Any, p: Any
) -> dict[str, tuple[float, float]]:
    """Return `Domain.envelope`, state -> (lowest, highest), at x and p of a trim."""
    limits = envelope(_declared(factors, x), _declared(factors, p))
    return {
        name: (low * factors[name], high * factors[name]) for name, (low, high) in limits.items()
    }


def _check(factors: Mapping[str, float], check: Callable[[Any], None], x: Any) -> None:
    """Raise BadInputError as `Domain.check` does, whose message has declared units."""
    check(_declared(factors, x))


def _begin(
    factors: Mapping[str, float],
    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    imposed: Mapping[str, Any],
) -> dict[str, Any]:
    """Return `Trimming.begin`, variable -> initial value of a trim search."""
    declared = {name: value / factors.get(name, 1.0) for name, value in imposed.items()}
    return _scaled(factors, begin(declared))


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """Return a value in the unit system of a model.

    model: the model, possibly converted to SI
    value: value in the English unit `unit`
    """
    return value * si_factor(unit) if model.source.native else value


def unit_of(model: Model, unit: str) -> str:
    """Return the unit of a value that `in_units_of` returns.

    model: the model, possibly converted to SI
    unit: the English unit
    """
    return si_unit(unit) if model.source.native else unit
