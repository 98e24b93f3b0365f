"""Conversion of a model to SI units.

Declaration and equations are converted, so that all later steps work in SI without further
conversions.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

from hfa_aircraft.extras import Extras
from hfa_aircraft.model import Model
from hfa_aircraft.signals import VECTORS, Signal, record
from hfa_support.units import si_factor, si_unit


def in_si(model: Model) -> Model:
    """Return the aircraft with all signals in SI units.

    The result has the original model in `extras.native`. A model without English units is returned
    unchanged.
    """
    if all(si_unit(signal.unit) == signal.unit for signal in model.signals.values()):
        return model
    conversion = _Conversion.of(model)
    scaled: dict[str, Any] = {
        kind: {name: _signal_in_si(signal) for name, signal in getattr(model, kind).items()}
        for kind in (*VECTORS.values(), "outputs")
    }
    return replace(
        model,
        **scaled,
        equations=_Equations(conversion, model.equations),
        trim={name: value * si_factor(model.unit(name)) for name, value in model.trim.items()},
        extras=_extras_in_si(model, conversion),
    )


def _extras_in_si(model: Model, conversion: _Conversion) -> Extras:
    extras = model.extras
    return replace(
        extras,
        range={
            name: (largest * si_factor(model.unit(name)), whose)
            for name, (largest, whose) in extras.range.items()
        },
        envelope=extras.envelope and _Envelope(conversion, extras.envelope),
        check=extras.check and _Check(conversion, extras.check),
        explain=None,  # its words are in the units of the declaration
        begin=extras.begin and _Begin(extras.begin, _factors(model.signals)),
        native=model,
        made_by=in_si,
    )


def _signal_in_si(signal: Signal) -> Signal:
    factor = si_factor(signal.unit)
    return signal._replace(
        unit=si_unit(signal.unit),
        nominal=signal.nominal * factor,
        min=signal.min * factor,
        max=signal.max * factor,
        start=signal.start * factor,
        rate=None if signal.rate is None else signal.rate * factor,
    )


@dataclass(frozen=True)
class _Conversion:
    """Factors from the declared units to SI.

    vectors: "x", "u", "p", "w" -> (name, factor) of each component
    outputs: (name, factor) of each output
    """

    vectors: tuple[tuple[tuple[str, float], ...], ...]
    outputs: tuple[tuple[str, float], ...]

    @staticmethod
    def of(model: Model) -> _Conversion:
        """Return the factors of a model's signals."""
        vectors = tuple(_factors(getattr(model, kind)) for kind in VECTORS.values())
        return _Conversion(vectors, _factors(model.outputs))

    def states_in_si(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return values by state, or pairs of limits, in SI."""
        converted = {}
        for name, factor in self.vectors[0]:
            if name in values:
                value = values[name]
                limits = isinstance(value, tuple)
                converted[name] = tuple(end * factor for end in value) if limits else value * factor
        return converted

    def native(self, kind: str, vector: Any) -> Any:
        """Return a vector (x, u, p or w) in the declared units, with its names."""
        factors = dict(self.vectors[list(VECTORS).index(kind)])
        values = [value / factor for value, factor in zip(vector, factors.values(), strict=True)]
        return record(tuple(factors))(*values)


@dataclass(frozen=True)
class _Equations:
    """Equations of a converted model."""

    conversion: _Conversion
    equations: Callable[[Any, Any, Any, Any], tuple[Mapping[str, Any], Mapping[str, Any]]]

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return rates by state and outputs by name, in SI."""
        vectors = zip(VECTORS, (x, u, p, w), strict=True)
        native = [self.conversion.native(kind, vector) for kind, vector in vectors]
        rates, outputs = self.equations(*native)
        seen = {name: outputs[name] * factor for name, factor in self.conversion.outputs}
        return self.conversion.states_in_si(rates), seen


@dataclass(frozen=True)
class _Envelope:
    """Limits of flights about a trim of a converted model."""

    conversion: _Conversion
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]]

    def __call__(self, x: Any, p: Any) -> Mapping[str, tuple[float, float]]:
        """Return state -> limits, in SI."""
        state = self.conversion.native("x", x)
        parameters = self.conversion.native("p", p)
        return self.conversion.states_in_si(self.envelope(state, parameters))


@dataclass(frozen=True)
class _Check:
    """Check of a state of a converted model."""

    conversion: _Conversion
    check: Callable[[Any], None]

    def __call__(self, x: Any) -> None:
        """Raise BadInputError, in the declared units, outside the domain of the equations."""
        self.check(self.conversion.native("x", x))


@dataclass(frozen=True)
class _Begin:
    """Initial values of the searches of a converted model.

    factors: (name, factor to SI) of every signal
    """

    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    factors: tuple[tuple[str, float], ...]

    def __call__(self, imposed: Mapping[str, Any]) -> dict[str, Any]:
        """Return name -> initial value, in SI."""
        factors = dict(self.factors)
        native = {name: value / factors.get(name, 1.0) for name, value in imposed.items()}
        starts = self.begin(native)
        return {name: value * factors.get(name, 1.0) for name, value in starts.items()}


def _factors(signals: Mapping[str, Signal]) -> tuple[tuple[str, float], ...]:
    return tuple((name, si_factor(signal.unit)) for name, signal in signals.items())
