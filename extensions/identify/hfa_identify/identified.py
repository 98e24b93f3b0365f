"""`hfa.identify`: a model's parameters from flight records, with bands and what follows."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any, TypeAlias

import numpy as np

from hfa_aircraft.model import Model
from hfa_identify.bands import BAND, correlations, covariance, white_covariance, whiteness
from hfa_identify.fit import Fit, OutputError
from hfa_identify.records import Record, read_record, record_of
from hfa_identify.response import Responses
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result
from hfa_support.reporting.text import Table, shown_unit, shown_value

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: A record, arrays by name, or the path of a file.
AnyRecord: TypeAlias = Record | Mapping[str, Any] | str | Path
#: Duration of the windows, s, in which parameters are found before the whole record is simulated.
_WINDOW = 1.0
#: The step, in standard deviations, at which the search in windows ends.
_ROUGH = 0.5
#: Estimates that are correlated by more are named.
_CORRELATED = 0.9
#: A parameter whose band is wider than this many times its value is not determined.
_WIDE = 2.0
#: A quantity of whose variation the model explains a smaller part is not explained.
_EXPLAINED = 0.5
#: Residuals of which a smaller share of lags is white are coloured.
_WHITE = 0.8


@dataclass(frozen=True)
class Estimate(Result):
    """An identified parameter.

    value: its estimate.
    low: lower end of its 95 % band.
    high: upper end of its 95 % band.
    start: its value before.
    unit: of all four.
    """

    value: float
    low: float
    high: float
    start: float
    unit: str


@dataclass(frozen=True)
class FittedQuantity(Result):
    """How well a measured quantity is explained.

    fit: 1 - (variance of its residuals) / (its variance).
    noise: standard deviation of its residuals.
    white: share of the first 25 lags at which the autocorrelation of its residuals is that of
        white noise, 0.95 where they are white.
    theil: Theil's inequality coefficient on the records that were kept out; None without any.
    unit: of the noise.
    """

    fit: float
    noise: float
    white: float
    theil: float | None
    unit: str


@dataclass(frozen=True, eq=False, repr=False)
class Identified(Result, Reported):
    """What flight records say of a model's parameters.

    model: the aircraft with the estimates as parameters.
    records: names of the records.
    parameters: name -> estimate with its 95 % band, corrected for coloured residuals.
    quantities: measured state or output -> how well it is explained.
    covariance: of the estimates, in the order of `parameters`.
    coloured: largest factor by which the correction widened a band.
    correlated: pairs of estimates that are correlated by more than 0.9, with the coefficient.
    undetermined: parameters that the records do not tell.
    at_bounds: parameters that end at a limit of the model.
    unexplained: quantities of whose variation the model explains less than half.
    converged: whether the search ended at a maximum of the likelihood.
    steps: of Gauss and Newton.
    """

    schema = "hfa.identified/1"
    made_by = "hfa identify"
    keys = (
        "dynamics=model.name first_line ok records parameters quantities covariance coloured "
        "correlated undetermined at_bounds unexplained converged steps"
    )

    model: Model
    records: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    quantities: Mapping[str, FittedQuantity]
    covariance: Matrix
    coloured: float
    correlated: tuple[tuple[str, str, float], ...]
    undetermined: tuple[str, ...]
    at_bounds: tuple[str, ...]
    unexplained: tuple[str, ...]
    converged: bool
    steps: int
    fitted: tuple[tuple[Record, np.ndarray], ...] = field(repr=False)

    @property
    def ok(self) -> bool:
        """Whether the estimates can be used: converged, explained, within limits, determined."""
        return self.converged and not (self.unexplained or self.at_bounds or self.undetermined)

    @property
    def findings(self) -> Iterator[str]:
        """What speaks against the estimates, worst first."""
        if not self.converged:
            yield "the search did not end at a maximum of the likelihood"
        if self.unexplained:
            names = ", ".join(self.unexplained)
            yield f"the model does not explain {names}"
        if self.at_bounds:
            yield f"at a limit of the model: {', '.join(self.at_bounds)}"
        if self.undetermined:
            yield f"not determined by the records: {', '.join(self.undetermined)}"

    @property
    def first_line(self) -> str:
        """The verdict and at most two findings."""
        findings = list(self.findings)[:2]
        count = f"{len(self.parameters)} parameters of {len(self.records)} record"
        count += "s" if len(self.records) > 1 else ""
        return f"PASS: {count}" if self.ok else f"FAIL: {'; '.join(findings)}"

    def draws(self, count: int, seed: int = 0) -> list[Model]:
        """Aircraft whose parameters are drawn from the estimates' normal distribution, within the
        model's limits.

        count: of aircraft. seed: of the draws.

        NoSolutionError where the records do not determine every parameter.
        """
        if self.undetermined:
            raise NoSolutionError(
                f"no aircraft can be drawn: {', '.join(self.undetermined)} not determined by the"
                " records; leave them out of free"
            )
        generator = np.random.default_rng(seed)
        values = [estimate.value for estimate in self.parameters.values()]
        drawn = generator.multivariate_normal(values, self.covariance, size=count)
        signals = [self.model.parameters[name] for name in self.parameters]
        lowest = [signal.min for signal in signals]
        highest = [signal.max for signal in signals]
        names = list(self.parameters)
        return [
            self.model.with_parameters(**dict(zip(names, row.tolist(), strict=True)))
            for row in np.clip(drawn, lowest, highest)
        ]

    def report(self) -> Report:
        """The estimates, how well the records are explained, and what is not determined."""
        findings = list(self.findings)
        parts: list[Any] = [self._estimates(), self._explained()]
        if self.correlated:
            rows = [(one, other, f"{value:.3f}") for one, other, value in self.correlated]
            parts.append(Table(("correlated", "with", "coefficient"), tuple(rows)))
        parts.append(
            f"The bands are 95 %; coloured residuals widen them up to {self.coloured:.2g} times."
        )
        title = f"Identification, {self.model.title}: {self.first_line}"
        return Report(title, tuple(parts), notes=findings[2:], data=self.to_dict())

    def _estimates(self) -> Table:
        """A row a parameter."""
        rows = []
        for name, each in self.parameters.items():
            half = 0.5 * (each.high - each.low)
            share = f"{100.0 * half / abs(each.value):.2g} %" if each.value else "-"
            ends = [f"{value:.6g}" for value in (each.value, each.low, each.high)]
            rows.append((name, *ends, share, f"{each.start:.6g}", shown_unit(each.unit)))
        return Table(
            ("parameter", "estimate", "low", "high", "band", "before", "unit"), tuple(rows)
        )

    def _explained(self) -> Table:
        """A row a measured quantity."""
        rows = []
        for name, each in self.quantities.items():
            theil = "-" if each.theil is None else f"{each.theil:.3f}"
            noise = f"{shown_value(each.noise, each.unit)} {shown_unit(each.unit)}"
            white = f"{100.0 * each.white:.0f} %"
            rows.append((name, f"{100.0 * each.fit:.2f} %", noise, white, theil))
        return Table(("measured", "explained", "noise", "white lags", "Theil"), tuple(rows))

    def figure(self) -> Figure:
        """Measured and fitted quantities over time, a panel each."""
        from hfa_identify.identified_figure import identified_figure

        return identified_figure(self)


def identify(
    model: Model,
    records: AnyRecord | Sequence[AnyRecord],
    free: Sequence[str],
    *,
    hold: Mapping[str, float] | None = None,
    validate: Sequence[AnyRecord] = (),
    progress: Callable[[float, float], None] | None = None,
) -> Identified:
    """The parameters of a model that make its response to the inputs of flight records most likely
    (output error, maximum likelihood, white Gaussian noise of unknown variance).

    model: with the values at which the search begins.
    records: of one or more manoeuvres, each a path or a dictionary of arrays by name in the model's
        units: time (s), every input, measured states or outputs, NaN where a sample is missing.
    free: names of parameters.
    hold: inputs without a column, and unmeasured states at the start -> value.
    validate: records that are kept out, on which Theil's coefficient is computed.

    BadInputError where a record or a name is wrong. NoSolutionError where the simulation diverges.

    >>> import hfa
    >>> found = hfa.identify(model, "flight.csv", ["Cm_q"])  # doctest: +SKIP
    """
    held = dict(hold or {})
    for name in held:
        refuse_unknown(
            "hold names the unknown input or state", name, (*model.inputs, *model.states)
        )
    given = [records] if isinstance(records, Record | Mapping | str | Path) else list(records)
    if not given:
        raise BadInputError("identify has no records; give at least one")
    read = _as_records(model, given, held)
    kept_out = _as_records(model, validate, held)
    names = _free_names(model, free)
    measured = tuple(dict.fromkeys(name for record in read for name in record.measured))
    responses = Responses(model, names, measured)
    bounds = np.array([(model.parameters[name].min, model.parameters[name].max) for name in names])
    theta = np.array([model.parameters[name].start for name in names])
    try:
        fit = _fitted(responses, read, bounds, theta, held, progress)
        theils = _theils(responses, kept_out, fit, held)
    except FloatingPointError as error:
        raise NoSolutionError(
            f"no parameters were found: {error} at the values where the search begins; start"
            " nearer, or give shorter records"
        ) from error
    return _identified(responses, read, fit, bounds, theils)


def _as_records(model: Model, given: Sequence[Any], held: Mapping[str, float]) -> list[Record]:
    """Records of what a caller gave."""
    read = []
    for number, each in enumerate(given, start=1):
        if isinstance(each, str | Path):
            each = read_record(each, model, held)
        elif not isinstance(each, Record):
            each = record_of(model, each, held, f"record {number}")
        read.append(each)
    return read


def _free_names(model: Model, free: Sequence[str]) -> tuple[str, ...]:
    """The names to identify. BadInputError where there are none, or one is no parameter."""
    if isinstance(free, str) or not free:
        raise BadInputError("free names no parameters; give a list of at least one")
    for name in free:
        refuse_unknown(f"{model.name} has no parameter", name, tuple(model.parameters))
    return tuple(dict.fromkeys(free))


def _fitted(
    responses: Responses,
    records: Sequence[Record],
    bounds: np.ndarray,
    theta: np.ndarray,
    held: Mapping[str, float],
    progress: Callable[[float, float], None] | None,
) -> Fit:
    """The fit of whole records, from that of short windows of them.

    In a short window no simulation diverges from a start far off."""
    windows = [part for record in records for part in record.windows(_WINDOW)]
    guesses = [_start(responses.model, part, held) for part in windows]
    search = OutputError(responses, windows, bounds, guesses)
    first = search.fit(theta, guesses, progress, small=_ROUGH)
    starts = [_start(responses.model, record, held) for record in records]
    whole = OutputError(responses, records, bounds, starts)
    try:
        return whole.fit(first.theta, starts, progress)
    except FloatingPointError:
        return whole.fit(theta, starts, progress)


def _start(model: Model, record: Record, held: Mapping[str, float]) -> np.ndarray:
    """(n,) where a record may begin: measured, held, or where the model's trims do."""
    start = []
    for name, signal in model.states.items():
        values = record.measured.get(name)
        seen = values[np.isfinite(values)] if values is not None else np.empty(0)
        if len(seen):
            start.append(float(seen[0]))
        else:
            start.append(float(held.get(name, model.trim.get(name, signal.start))))
    return np.array(start)


def _theils(
    responses: Responses, records: Sequence[Record], fit: Fit, held: Mapping[str, float]
) -> dict[str, float]:
    """Theil's inequality coefficient by quantity, on records that were kept out:
    rms(z - y) / (rms(z) + rms(y)), their starts alone being fitted."""
    if not records:
        return {}
    fixed = np.column_stack([fit.theta, fit.theta])
    starts = [_start(responses.model, record, held) for record in records]
    found = OutputError(responses, records, fixed, starts).fit(fit.theta, starts)
    theils = {}
    for place, name in enumerate(responses.measured):
        flags = np.concatenate([present[:, place] for present in found.present])
        if not flags.any():
            continue
        misses = np.concatenate([each[:, place] for each in found.residuals])[flags]
        y = np.concatenate([each.y[:, place] for each in found.responses])[flags]
        sizes = np.sqrt(np.mean((y + misses) ** 2)) + np.sqrt(np.mean(y**2))
        theils[name] = float(np.sqrt(np.mean(misses**2)) / max(sizes, 1e-300))
    return theils


def _identified(
    responses: Responses,
    records: Sequence[Record],
    fit: Fit,
    bounds: np.ndarray,
    theils: Mapping[str, float],
) -> Identified:
    """The result of a fit."""
    model = responses.model
    names = responses.free
    C = covariance(fit)
    half = BAND * np.sqrt(np.maximum(np.diag(C), 0.0))
    white = np.sqrt(np.diag(white_covariance(fit)))
    estimates = {
        name: Estimate(
            float(value),
            float(value - width),
            float(value + width),
            model.parameters[name].start,
            model.parameters[name].unit,
        )
        for name, value, width in zip(names, fit.theta, half, strict=True)
    }
    wide = [
        name
        for name, value, width in zip(names, fit.theta, half, strict=True)
        if not width <= _WIDE * max(abs(value), abs(model.parameters[name].start))
    ]
    quantities = {
        name: _quantity(responses, fit, place, theils.get(name))
        for place, name in enumerate(responses.measured)
    }
    values = dict(zip(names, fit.theta.tolist(), strict=True))
    return Identified(
        model=model.with_parameters(**values),
        records=tuple(record.name for record in records),
        parameters=estimates,
        quantities=quantities,
        covariance=C,
        coloured=_widest(half, BAND * white),
        correlated=tuple(_correlated(names, C)),
        undetermined=tuple(wide),
        at_bounds=tuple(
            name
            for name, value, ends in zip(names, fit.theta, bounds, strict=True)
            if value in ends
        ),
        unexplained=tuple(name for name, each in quantities.items() if each.fit < _EXPLAINED),
        converged=fit.converged,
        steps=fit.steps,
        fitted=tuple((r, response.y) for r, response in zip(records, fit.responses, strict=True)),
    )


def _widest(corrected: np.ndarray, white: np.ndarray) -> float:
    """The largest factor by which the correction for coloured residuals widened a band."""
    seen = np.isfinite(white) & (white > 0.0)
    return float(np.max(corrected[seen] / white[seen], initial=1.0))


def _correlated(names: Sequence[str], C: np.ndarray) -> Iterator[tuple[str, str, float]]:
    """Pairs of estimates with a large correlation."""
    table = correlations(C)
    for i, one in enumerate(names):
        for j in range(i + 1, len(names)):
            if abs(table[i, j]) > _CORRELATED:
                yield one, names[j], float(table[i, j])


def _quantity(responses: Responses, fit: Fit, place: int, theil: float | None) -> FittedQuantity:
    """How well a measured quantity is explained."""
    explained = 0.0
    varied = 0.0
    whites = []
    for residual, present, response in zip(fit.residuals, fit.present, fit.responses, strict=True):
        flags = present[:, place]
        if not flags.any():
            continue
        seen = (response.y[:, place] + residual[:, place])[flags]
        explained += float((residual[flags, place] ** 2).sum())
        varied += float(((seen - seen.mean()) ** 2).sum())
        whites.append(whiteness(residual[:, place], flags))
    name = responses.measured[place]
    return FittedQuantity(
        1.0 - explained / varied,
        float(np.sqrt(fit.noise[place])),
        float(np.mean(whites)),
        theil,
        responses.model.unit(name),
    )
