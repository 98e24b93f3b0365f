"""Conversion of a model to SI units.

The declaration and the equations are converted. All later computations are then in SI units.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_aircraft.signals import VECTORS, Signal, record
from hfa_aircraft.source import Extras
from hfa_support.units import si_factor, si_unit


def in_si(model: Model) -> Model:
    """Return a model with all signals in SI units.

    `extras.native` of the result is the original model. A model without English units is returned
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
        explain=None,  # its text has values in the declared units
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
    """Factors from a model's declared units to SI units.

    vectors: pairs (name, factor) for the components of x, u, p and w, in this order
    outputs: pair (name, factor) for each output
    """

    vectors: tuple[tuple[tuple[str, float], ...], ...]
    outputs: tuple[tuple[str, float], ...]

    @staticmethod
    def of(model: Model) -> _Conversion:
        """Return the factors from the declared units of a model to SI units."""
        vectors = tuple(_factors(getattr(model, kind)) for kind in VECTORS.values())
        return _Conversion(vectors, _factors(model.outputs))

    def states_in_si(self, values: Mapping[str, Any]) -> dict[str, Any]:
        """Return state -> value in SI units. A value may also be a pair of limits.

        values: state -> value in the declared units
        """
        converted = {}
        for name, factor in self.vectors[0]:
            if name in values:
                value = values[name]
                limits = isinstance(value, tuple)
                converted[name] = tuple(end * factor for end in value) if limits else value * factor
        return converted

    def native(self, kind: str, vector: Any) -> Any:
        """Return a vector in the declared units, as a named tuple.

        kind: "x", "u", "p" or "w"
        vector: the vector in SI units
        """
        factors = dict(self.vectors[list(VECTORS).index(kind)])
        values = [value / factor for value, factor in zip(vector, factors.values(), strict=True)]
        return record(tuple(factors))(*values)


@dataclass(frozen=True)
class _Equations:
    """Equations of motion in SI units, for a model with other declared units.

    conversion: factors from the declared units to SI
    equations: equations of the original model
    """

    conversion: _Conversion
    equations: Callable[..., Any]

    def __call__(self, x: Any, u: Any, p: Any, w: Any) -> tuple[dict[str, Any], dict[str, Any]]:
        """Return state -> rate and output -> value, in SI units.

        x, u, p, w: state, input, parameters and disturbances in SI units
        """
        vectors = zip(VECTORS, (x, u, p, w), strict=True)
        native = [self.conversion.native(kind, vector) for kind, vector in vectors]
        rates, outputs = self.equations(*native)
        seen = {name: outputs[name] * factor for name, factor in self.conversion.outputs}
        return self.conversion.states_in_si(rates), seen


@dataclass(frozen=True)
class _Envelope:
    """Limits of the states in flight in SI units: `Extras.envelope` of a converted model.

    conversion: factors from the declared units to SI
    envelope: function `Extras.envelope` of the original model
    """

    conversion: _Conversion
    envelope: Callable[[Any, Any], Mapping[str, tuple[float, float]]]

    def __call__(self, x: Any, p: Any) -> Mapping[str, tuple[float, float]]:
        """Return state -> (lowest, highest) in flight, in SI.

        x, p: state and parameters of the trim, in SI
        """
        state = self.conversion.native("x", x)
        parameters = self.conversion.native("p", p)
        return self.conversion.states_in_si(self.envelope(state, parameters))


@dataclass(frozen=True)
class _Check:
    """Check of the domain of the equations in SI units: `Extras.check` of a converted model.

    conversion: factors from the declared units to SI
    check: function `Extras.check` of the original model
    """

    conversion: _Conversion
    check: Callable[[Any], None]

    def __call__(self, x: Any) -> None:
        """Raise BadInputError if a state is outside the domain of the equations.

        The message contains values in the declared units.

        x: state, in SI
        """
        self.check(self.conversion.native("x", x))


@dataclass(frozen=True)
class _Begin:
    """Initial values of a trim search in SI units: `Extras.begin` of a converted model.

    begin: function `Extras.begin` of the original model, in the original units
    factors: (name, factor to SI) of each signal
    """

    begin: Callable[[Mapping[str, Any]], Mapping[str, Any]]
    factors: tuple[tuple[str, float], ...]

    def __call__(self, imposed: Mapping[str, Any]) -> dict[str, Any]:
        """Return variable -> initial value of a trim search, in SI.

        imposed: variable -> imposed value, in SI
        """
        factors = dict(self.factors)
        native = {name: value / factors.get(name, 1.0) for name, value in imposed.items()}
        starts = self.begin(native)
        return {name: value * factors.get(name, 1.0) for name, value in starts.items()}


def _factors(signals: Mapping[str, Signal]) -> tuple[tuple[str, float], ...]:
    return tuple((name, si_factor(signal.unit)) for name, signal in signals.items())


def native_of(model: Model) -> Model:
    """Return the model in its declared units.

    The result is the original of a model that `in_si` converted, and otherwise the model itself.
    """
    return model if model.extras.native is None else model.extras.native


def native_values(model: Model, names: tuple[str, ...], values: Any) -> np.ndarray:
    """Return values of signals in the units that the original model declares.

    model: the model, possibly converted to SI
    names: names of the signals
    values: values in the units of `model`, (..., names)
    """
    array = np.asarray(values, dtype=float)
    native = model.extras.native
    return array if native is None else array / [si_factor(native.unit(name)) for name in names]


def in_units_of(model: Model, value: Any, unit: str) -> Any:
    """Return a value in the unit system of a model.

    model: the model, possibly converted to SI
    value: value in the English unit `unit`
    """
    return value if model.extras.native is None else value * si_factor(unit)


def unit_of(model: Model, unit: str) -> str:
    """Return the unit of a value that `in_units_of` returns.

    model: the model, possibly converted to SI
    unit: the English unit
    """
    return unit if model.extras.native is None else si_unit(unit)


#: Ending of a name -> factor on the unit of the name without it.
_ENDS = {
    "_command_end": "",
    "_rate": "/s",
    "_command": "",
    "_estimate": "",
    "_integral": " s",
    "_position": "",
}


def signal_unit(model: Model, name: str) -> str:
    """Return the unit of a controller signal, derived from its name, or "" if the unit is unknown.

    Examples are ft/s for speed_estimate, and ft/s^2 s for the integral of an acceleration.
    """
    without_lag = re.sub(r"_lag_\d+$", "", name).removeprefix("model_")
    whole, _ = model.part(without_lag)
    if whole in model.signals:
        return model.unit(whole)
    for ending, times in _ENDS.items():
        if without_lag.endswith(ending):
            unit = signal_unit(model, without_lag.removesuffix(ending))
            if not unit:
                return ""
            # "(ft/s)/s" instead of "ft/s/s".
            return re.sub(r"^(.*/.*)/s$", r"(\1)/s", unit + times)
    return ""
