"""`hfa.identify`: identification of a model's parameters from flight records."""

from __future__ import annotations

import fnmatch
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from itertools import combinations
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.fit import Fit, OutputError
from hfa_identify.identified import Estimate, FittedQuantity, Identified
from hfa_identify.records import Record, read_record
from hfa_identify.residuals import (
    BAND,
    WORSE,
    correlations,
    covariance,
    determination,
    misfits,
    white_covariance,
    whiteness,
)
from hfa_identify.response import Responses, biases
from hfa_support.arrays.tables import sources
from hfa_support.errors import BadInputError, NoSolutionError, is_finite, refuse_unknown, shown

#: Interpolations of the inputs between samples.
INPUTS = ("linear", "steps")
#: Pairs of estimates with a larger correlation are reported.
_CORRELATED = 0.9
#: Number of samples from which machine code is faster, including its compilation.
_WORTH_COMPILING = 10_000
#: A parameter is not determined if the half-width of its band exceeds its value by this factor.
_WIDE = 2.0


def identify(
    model: Model,
    records: Any,
    free: Sequence[str] | str = (),
    *,
    given: Mapping[str, float] | Sequence[str] = (),
    hold: Mapping[str, float] | None = None,
    inputs: str | None = None,
    progress: Callable[[float, float], None] | None = None,
) -> Identified:
    """Identify parameters of a model from flight records by maximum likelihood.

    The method is output error. The measurement noise is white and Gaussian with unknown variance.

    model: aircraft whose parameter values are the initial values of the search.
    records: one maneuver or several. Each is a path, a flight, a pandas table, or a dictionary of
        arrays by name in the model's units: time (s), every input, measured states or outputs. NaN
        marks a missing sample.
    free: names of parameters, or patterns such as "Cm_*". The bias of a column can be free too,
        such as bias_alpha: recorded(t) = true(t) + bias.
    given: parameters that keep their values although a pattern matches them, or name -> fixed
        value.
    hold: input without a column, or initial value of an unmeasured state -> value.
    inputs: "linear" or "steps", the interpolation between samples, by default that of the likelier
        of both fits. Commands of a flight computer are steps.
    progress: function called with (work done, total work).

    Raises BadInputError for an invalid record, name or combination of arguments. Raises
    NoSolutionError if the simulation diverges.

    >>> import hfa
    >>> found = hfa.identify(model, "flight.csv", ["Cm_q"])  # doctest: +SKIP
    """
    held = dict(hold or {})
    for name in held:
        refuse_unknown(
            "hold names the unknown input or state", name, (*model.inputs, *model.states)
        )
    model, fixed = _with_given(model, given)
    if inputs is not None:
        refuse_unknown("inputs are", inputs, INPUTS)
    read = [read_record(source, model, held, name) for name, source in sources(records, "record")]
    measured = tuple(dict.fromkeys(name for record in read for name in record.measured))
    names = _free_names(model, free, fixed, measured)
    responses = Responses(model, names, measured)
    if sum(len(record.time) for record in read) > _WORTH_COMPILING:
        responses.compile()
    guesses = [_initial_state(model, record, held) for record in read]
    fits: list[Fit] = []
    is_open = inputs is None and any(np.ptp(record.inputs, axis=0).any() for record in read)
    try:
        for has_steps in (False, True) if is_open else (inputs == "steps",):
            of_kind = [replace(record, has_steps=has_steps) for record in read]
            begin = fits[0] if fits else None
            fits.append(OutputError(responses, of_kind, guesses).fit(progress, begin))
    except FloatingPointError as error:
        raise NoSolutionError(
            f"no parameters were found: {error} with the initial parameter values; give better "
            "initial values, or shorter records, and check units and signs of the columns"
        ) from error
    best = min(fits, key=lambda fit: (not fit.converged, fit.likelihood))
    return _identified(best, is_chosen=len(fits) > 1)


def _with_given(
    model: Model, given: Mapping[str, float] | Sequence[str]
) -> tuple[Model, tuple[str, ...]]:
    """Return the model with the fixed values of parameters, and the names of these parameters."""
    names = tuple(given)
    for name in names:
        refuse_unknown(f"{model.name} has no parameter", name, tuple(model.parameters))
    if not isinstance(given, Mapping):
        return model, names
    for name, value in given.items():
        if not is_finite(value):
            raise BadInputError(f"given: {name} is {shown(value)}; give a finite number")
    return model.with_parameters(**given), names


def _free_names(
    model: Model, free: Sequence[str], given: Sequence[str], measured: Sequence[str]
) -> tuple[str, ...]:
    """Return the parameters and biases selected by the names and patterns in `free`."""
    if isinstance(free, str) or not free:
        if not model.parameters:
            raise BadInputError(
                f"{model.name} has no parameters to identify; declare parameters by Model(..., "
                "parameters={NAME: Signal(...)})"
            )
        possible = ", ".join(model.parameters)
        raise BadInputError(
            f"free contains no list of parameters; give a list with at least one of {possible}"
        )
    known = (*model.parameters, *biases(model, (*model.inputs, *measured)))
    names: list[str] = []
    for name in free:
        if any(sign in name for sign in "*?["):
            matching = fnmatch.filter(model.parameters, name)
            matching = [parameter for parameter in matching if parameter not in given]
            if not matching:
                raise BadInputError(
                    f"no free parameter of {model.name} matches {name!r}; remove this pattern"
                )
            names += matching
            continue
        refuse_unknown(f"{model.name} has no parameter", name, known)
        if name in given:
            raise BadInputError(
                f"{name} is both free and given; free or give the parameter, not both"
            )
        names.append(name)
    return tuple(dict.fromkeys(names))


def _initial_state(model: Model, record: Record, held: Mapping[str, float]) -> np.ndarray:
    """Return the guess of a record's initial state, (n,), to which `held` gives values by name."""
    # Each component is the first finite measured value, the held value, the value in the model's
    # trim, or the declared start of the state, in this order of precedence.
    start = []
    for name, signal in model.states.items():
        values = record.measured.get(name)
        seen = values[np.isfinite(values)] if values is not None else np.empty(0)
        if len(seen):
            start.append(float(seen[0]))
        else:
            start.append(float(held.get(name, model.trim.get(name, signal.start))))
    return np.array(start)


def _identified(fit: Fit, *, is_chosen: bool) -> Identified:
    """Return the result of an identification, from the best fit.

    is_chosen: whether it is the likelier of two fits, with inputs that are linear and held
    """
    search, theta = fit.search, fit.theta.tolist()
    responses, names = search.responses, search.responses.free
    model = responses.model
    C = covariance(fit)
    half_widths = BAND * np.sqrt(np.maximum(np.diag(C), 0.0))
    white_half_widths = BAND * np.sqrt(np.diag(white_covariance(fit)))
    estimates = {
        name: Estimate(value, value - half, value + half, signal.start, signal.unit)
        for (name, signal), value, half in zip(
            responses.signals.items(), theta, half_widths.tolist(), strict=True
        )
    }
    # Biases of columns are not parameters of the model.
    of_model = {name: estimate for name, estimate in estimates.items() if name in model.parameters}
    undetermined = tuple(
        name
        for name, estimate in of_model.items()
        if not estimate.high - estimate.value
        <= _WIDE * max(abs(estimate.value), abs(estimate.start))
    )
    quantities = _quantities(responses, fit)
    with np.errstate(invalid="ignore"):  # nan where a band is 0 or infinite
        widenings = half_widths / white_half_widths
    return Identified(
        model=model.with_parameters(
            **{name: estimate.value for name, estimate in of_model.items()}
        ),
        records=tuple(record.name for record in search.records),
        parameters=estimates,
        quantities=quantities,
        covariance=C,
        misfits=tuple(misfits(fit)),
        coloured=float(np.nanmax([1.0, *widenings])),
        correlated=tuple(_correlated(names, C)),
        undetermined=undetermined,
        at_bounds=tuple(
            name
            for name, value, ends in zip(names, theta, search.bounds, strict=True)
            if value in ends
        ),
        unexplained=tuple(name for name, each in quantities.items() if each.fit < WORSE),
        converged=fit.converged,
        steps=fit.steps,
        inputs=INPUTS[search.records[0].has_steps],
        is_chosen=is_chosen,
        starts=tuple(
            {
                name: value
                for name, value in zip(model.states, start.tolist(), strict=True)
                if name in record.measured or (name in model.steady and name not in record.held)
            }
            for record, start in zip(search.records, fit.starts, strict=True)
        ),
        fitted=tuple(
            (record, simulated.y)
            for record, simulated in zip(search.records, fit.simulated, strict=True)
        ),
    )


def _correlated(names: Sequence[str], C: np.ndarray) -> Iterator[tuple[str, str, float]]:
    """Yield (name, name, coefficient) of the pairs of estimates beyond `_CORRELATED`."""
    coefficients = correlations(C)
    for (i, one), (j, other) in combinations(enumerate(names), 2):
        if abs(coefficients[i, j]) > _CORRELATED:
            yield one, other, float(coefficients[i, j])


def _quantities(responses: Responses, fit: Fit) -> dict[str, FittedQuantity]:
    """Return name -> quality of the fit, for each measured quantity."""
    coefficients = determination(fit)
    quantities = {}
    for place, name in enumerate(responses.measured):
        white_fractions = [
            whiteness(residual[:, place], present[:, place])
            for residual, present in zip(fit.residuals, fit.present, strict=True)
            if present[:, place].any()
        ]
        quantities[name] = FittedQuantity(
            fit=float(coefficients[place]),
            noise=float(np.sqrt(fit.noise[place])),
            white=float(np.mean(white_fractions)),
            unit=responses.model.unit(name),
        )
    return quantities
