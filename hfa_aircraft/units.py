"""Conversion of a model to SI units, or to coherent units with radians.

The declaration and the equations are converted. All later computations are then in these units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import lru_cache, partial
from typing import Any, NamedTuple

from hfa_aircraft.about import Domain, Source, Trimming
from hfa_aircraft.model import Model
from hfa_aircraft.signals import VECTORS, Signal, record
from hfa_support.units import (
    ENGLISH_BASES,
    SI_BASES,
    coherent_unit,
    conversion,
    si_factor,
    si_unit,
)


class _System(NamedTuple):
    """Units of a converted model.

    unit: declared unit -> unit in the system
    factor: declared unit -> number of units of the system in it
    """

    unit: Callable[[str], str]
    factor: Callable[[str], float]


_SI = _System(si_unit, si_factor)


def in_si(model: Model) -> Model:
    """Return a model with all signals in SI units.

    `source.native` of the result is the original model. A model without English units is returned
    unchanged.
    """
    return _converted(model, _SI, in_si)


@lru_cache(maxsize=16)
def coherent(model: Model) -> Model:
    """Return a model in radians and units of one system, as the figures of reports require.

    The system is that of feet, slugs and pounds if a unit has feet, and SI otherwise. Signals in
    units of it are unchanged, and all signals of a model whose time is not in seconds.
    """
    if model.time_unit != "s":
        return model
    words = " ".join(signal.unit for signal in model.signals.values())
    bases = ENGLISH_BASES if re.search(r"\bft\b", words) else SI_BASES

    def unit_of_system(unit: str) -> str:
        return coherent_unit(unit, bases)

    def factor(unit: str) -> float:
        return conversion(unit, unit_of_system(unit)) or 1.0

    return _converted(model, _System(unit_of_system, factor), coherent)


def _converted(model: Model, system: _System, reload: Callable[[Model], Model]) -> Model:
    """Return a model with all signals in the units of a system.

    reload: function that converts the model again
    """
    if all(system.unit(signal.unit) == signal.unit for signal in model.signals.values()):
        return model
    conversion = _Conversion.of(model, system)
    factors = {name: system.factor(signal.unit) for name, signal in model.signals.items()}
    scaled: dict[str, Any] = {
        kind: {name: _signal_in(system, signal) for name, signal in getattr(model, kind).items()}
        for kind in (*VECTORS.values(), "outputs")
    }
    return replace(
        model,
        **scaled,
        equations=_Equations(conversion, model.equations),
        trim={name: value * factors[name] for name, value in model.trim.items()},
        domain=_converted_domain(model, conversion, factors),
        trimming=_converted_trimming(model, factors),
        source=Source(model.source.text, model.source.digest, native=model, reload=reload),
    )


def _converted_domain(
    model: Model, conversion: _Conversion, factors: Mapping[str, float]
) -> Domain:
    domain = model.domain
    return Domain(
        range={
            name: (low * factors[name], high * factors[name], source)
            for name, (low, high, source) in domain.range.items()
        },
        envelope=domain.envelope and partial(_envelope, conversion, domain.envelope),
        check=domain.check and partial(_check, conversion, domain.check),
        reference={name: value * factors[name] for name, value in domain.reference.items()},
    )


def _envelope(
    conversion: _Conversion,
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]],
    x: Any,
    p: Any,
) -> Mapping[str, tuple[float, float]]:
    """Return state -> (lowest, highest) in flight, for the state and parameters of a trim."""
    declared = envelope(conversion.in_declared_units("x", x), conversion.in_declared_units("p", p))
    return conversion.states(declared)


def _check(conversion: _Conversion, check: Callable[[Any], None], x: Any) -> None:
    """Raise BadInputError, with values in the declared units, for a state outside the domain."""
    check(conversion.in_declared_units("x", x))


def _converted_trimming(model: Model, factors: Mapping[str, float]) -> Trimming:
    """Return the trimming without explanations, whose texts have values in declared units."""
    begin = model.trimming.begin
    return replace(model.trimming, begin=begin and partial(_begin, begin, factors), explain=None)


def _begin(
    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]],
    factors: Mapping[str, float],
    imposed: Mapping[str, Any],
) -> dict[str, Any]:
    """Return variable -> initial value of a trim search."""
    declared = {name: value / factors.get(name, 1.0) for name, value in imposed.items()}
    return {name: value * factors.get(name, 1.0) for name, value in begin(declared).items()}


def _signal_in(system: _System, signal: Signal) -> Signal:
    factor = system.factor(signal.unit)
    return signal._replace(
        unit=system.unit(signal.unit),
        nominal=signal.nominal * factor,
        min=signal.min * factor,
        max=signal.max * factor,
        start=signal.start * factor,
        rate=None if signal.rate is None else signal.rate * factor,
    )


#: Pair (name, factor) for each signal of a vector.
_Factors = tuple[tuple[str, float], ...]


class _Conversion(NamedTuple):
    """Factors from a model's declared units to those of the converted model.

    x, u, p, w, outputs: factors of the components of state, input, parameters and disturbances,
      and of the outputs
    """

    x: _Factors
    u: _Factors
    p: _Factors
    w: _Factors
    outputs: _Factors

    @staticmethod
    def of(model: Model, system: _System) -> _Conversion:
        """Return the factors from the declared units of a model to those of a system."""

        def factors(signals: Mapping[str, Signal]) -> _Factors:
            return tuple((name, system.factor(signal.unit)) for name, signal in signals.items())

        vectors = {name: factors(getattr(model, kind)) for name, kind in VECTORS.items()}
        return _Conversion(**vectors, outputs=factors(model.outputs))

    def states(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return state -> converted value. A value may also be a pair of limits.

        values: state -> value in the declared units
        """
        converted = {}
        for name, factor in self.x:
            if name in values:
                value = values[name]
                is_limits = isinstance(value, tuple)
                converted[name] = (
                    tuple(end * factor for end in value) if is_limits else value * factor
                )
        return converted

    def in_declared_units(self, kind: str, converted: Any) -> Any:
        """Return a vector in the declared units, as a named tuple.

        kind: "x", "u", "p" or "w"
        converted: the vector in the converted units
        """
        pairs: _Factors = getattr(self, kind)
        names = tuple(name for name, _ in pairs)
        values = [value / factor for value, (_, factor) in zip(converted, pairs, strict=True)]
        return record(names)(*values)


@dataclass(frozen=True)
class _Equations:
    """Equations of motion in converted units.

    conversion: factors from the declared units
    equations: equations of the original model
    """

    conversion: _Conversion
    equations: Callable[..., Any]

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return state -> rate and output -> value.

        x, u, p, w: state, input, parameters and disturbances
        """
        vectors = zip(VECTORS, (x, u, p, w), strict=True)
        declared = [self.conversion.in_declared_units(kind, vector) for kind, vector in vectors]
        rates, outputs = self.equations(*declared)
        seen = {name: outputs[name] * factor for name, factor in self.conversion.outputs}
        return self.conversion.states(rates), seen


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """Return a value in the unit system of a model.

    model: the model, possibly converted to SI
    value: value in the English unit `unit`
    """
    return value if model.source.native is None else value * si_factor(unit)


def unit_of(model: Model, unit: str) -> str:
    """Return the unit of a value that `in_units_of` returns.

    model: the model, possibly converted to SI
    unit: the English unit
    """
    return unit if model.source.native is None else si_unit(unit)
