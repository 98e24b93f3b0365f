"""Result of an identification: estimates, bands and findings."""

from __future__ import annotations

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, fields
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.loading import load_model, relative_to
from hfa_aircraft.model import Model
from hfa_aircraft.uncertain import ParameterSpread
from hfa_identify.records import Record
from hfa_identify.residuals import WHITE, Misfit
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import Matrix, Result
from hfa_support.reporting.text import WIDTH, Table, beside_unit, shown_unit, shown_value, wrapped

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Ratio of an estimate to its value before, above which a check of the record is advised.
_FAR = 8.0
#: A smaller factor is reported as no widening of the bands.
_WIDENED = 1.05
#: With a larger factor the bands are not reliable, because the noise is slower than the maneuver.
_LARGEST_WIDENING = 8.0


@dataclass(frozen=True)
class Estimate(Result):
    """An identified parameter.

    value: estimate.
    low: lower end of the 95 % band.
    high: upper end of the 95 % band.
    start: value at the start of the search.
    unit: unit of `value`, `low`, `high` and `start`.
    """

    value: float
    low: float
    high: float
    start: float
    unit: str


@dataclass(frozen=True)
class FittedQuantity(Result):
    """Quality of the fit of one measured quantity.

    fit: 1 - (sum of squared residuals) / (sum of squared deviations from the mean of each record).
    noise: standard deviation of the residuals.
    white: fraction of the first 25 lags at which the autocorrelation of the residuals is within the
        95 % band of white noise, averaged over the records. White residuals have about 0.95.
    unit: unit of `noise`.
    """

    fit: float
    noise: float
    white: float
    unit: str


@dataclass(frozen=True, eq=False, repr=False)
class Identified(Result, Reported):
    """Parameters of a model identified from flight records.

    model: the aircraft with the estimates as its parameters.
    records: names of the records.
    parameters: name -> estimate with its 95 % band, corrected for colored residuals.
    quantities: measured state or output -> quality of its fit.
    covariance: covariance of the estimates, in the order of `parameters`.
    coloured: largest factor by which the correction widened a band.
    correlated: (name, name, coefficient) of each pair correlated by more than 0.9.
    undetermined: parameters that the records do not determine.
    at_bounds: parameters with an estimate at a limit of the model.
    unexplained: quantities whose simulated motion contradicts the measured motion.
    misfits: differences between records and model that are not noise, the clearest first.
    converged: whether the search converged to a maximum of the likelihood.
    steps: number of Gauss-Newton steps.
    inputs: "linear" or "steps", the inputs between samples.
    is_chosen: whether `inputs` are those of the likelier of both fits, and not given.
    starts: state -> fitted initial value, for each record: measured states, and those that a trim
        balances and nothing holds.
    """

    schema = "hfa.identified/1"

    model: Model
    records: tuple[str, ...]
    parameters: Mapping[str, Estimate]
    quantities: Mapping[str, FittedQuantity]
    covariance: Matrix
    misfits: tuple[Misfit, ...]
    coloured: float
    correlated: tuple[tuple[str, str, float], ...]
    undetermined: tuple[str, ...]
    at_bounds: tuple[str, ...]
    unexplained: tuple[str, ...]
    converged: bool
    steps: int
    inputs: str
    is_chosen: bool
    starts: tuple[Mapping[str, float], ...]
    fitted: tuple[tuple[Record, np.ndarray], ...] = field(repr=False)

    def __getitem__(self, name: str) -> Estimate:
        """Return the estimate of a parameter. Raises BadInputError for an unknown name."""
        refuse_unknown("no estimate of", name, tuple(self.parameters))
        return self.parameters[name]

    @property
    def ok(self) -> bool:
        """True if there are no findings."""
        return not list(self.findings)

    @property
    def residuals(self) -> list[dict[str, np.ndarray]]:
        """Measured quantity -> measured minus fitted values, (N,), for each record."""
        names = tuple(self.quantities)
        return [
            dict(zip(names, (record.table(names) - y).T, strict=True)) for record, y in self.fitted
        ]

    @property
    def findings(self) -> Iterator[str]:
        """Sentences on what makes the estimates doubtful, the most important first."""
        if self.undetermined:
            yield f"not determined: {', '.join(self.undetermined)}"
        if not self.converged:
            yield "the search did not converge"
        if self.unexplained:
            yield f"the model does not explain {', '.join(self.unexplained)}"
        yield from map(self._misfit_text, self.misfits)
        if self.coloured > _LARGEST_WIDENING:
            yield "residuals are colored beyond the correction of the bands"
        if self.at_bounds:
            yield f"at a limit of the model: {', '.join(self.at_bounds)}"

    def _misfit_text(self, misfit: Misfit) -> str:
        """Return the finding on a misfit."""
        where = f" in {misfit.record}" if len(self.records) > 1 else ""
        far = beside_unit(shown_value(misfit.difference, misfit.unit, ".3g"), misfit.unit)
        why = "as the inputs move"
        if misfit.samples:
            why = f"in {misfit.samples} sample{'s' * (misfit.samples > 1)}"
        return f"{misfit.quantity}{where} is off the model by {far} at {misfit.time:.4g} s, {why}"

    @property
    def far(self) -> tuple[str, ...]:
        """Parameters whose estimate has another sign than the start of the search, or differs from
        it by a factor of at least 8.
        """
        return tuple(
            name
            for name, estimate in self.parameters.items()
            if estimate.value * estimate.start < 0.0
            or (
                estimate.start * estimate.value > 0.0
                and not 1.0 / _FAR < estimate.value / estimate.start < _FAR
            )
        )

    @property
    def first_line(self) -> str:
        """The first line of the report: FAIL with at most two findings, or PASS."""
        if self._first_findings:
            return f"FAIL: {'; '.join(self._first_findings)}"
        parameters = "parameter" if len(self.parameters) == 1 else "parameters"
        records = "record" if len(self.records) == 1 else "records"
        return f"PASS: {len(self.parameters)} {parameters} of {len(self.records)} {records}"

    @property
    def _first_findings(self) -> list[str]:
        """The findings for the first line: two, or one if the line is too long."""
        findings = list(self.findings)[:2]
        line = f"FAIL: {'; '.join(findings)}"
        return findings if len(line) <= WIDTH else findings[:1]

    def draws(self, count: int, seed: int = 0) -> list[Model]:
        """Return aircraft with random parameters, normally distributed about the estimates.

        Parameters are clipped to the limits of the model.

        count: number of aircraft
        seed: seed of the random numbers

        Raises NoSolutionError if the records do not determine every parameter.
        """
        if self.undetermined:
            raise NoSolutionError(
                "no aircraft can be drawn: the records do not determine "
                f"{', '.join(self.undetermined)}; give these parameters fixed values"
            )
        names = [name for name in self.parameters if name in self.model.parameters]
        places = [list(self.parameters).index(name) for name in names]
        values = {name: self.parameters[name].value for name in names}
        spread = ParameterSpread(values, self.covariance[np.ix_(places, places)])
        return spread.aircraft(self.model, count, seed)

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        entries = {field.name: getattr(self, field.name) for field in fields(self)}
        del entries["model"], entries["fitted"]  # in the files of aircraft and records
        computed = {name: getattr(self, name) for name in ("far", "ok", "first_line")}
        return {"dynamics": self.model.name, **entries, **computed}

    def report(self) -> Report:
        """Return the report: estimates, quality of the fit, and findings."""
        further = list(self.findings)[len(self._first_findings) :]
        parts: list[Any] = [self._estimates(), self._explained()]
        unit = self.model.unit
        unseen = [
            (record, name, shown_value(value, unit(name)), shown_unit(unit(name)))
            for record, of_record in zip(self.records, self.starts, strict=True)
            for name, value in of_record.items()
            if name not in self.quantities
        ]
        if unseen:
            parts.append(Table(("record", "initial state, not measured", "fitted", "unit"), unseen))
        if self.far:
            values = ", ".join(
                f"{name} ({self[name].value:.4g}, before {self[name].start:.4g})"
                for name in self.far
            )
            sentence = f"Check the units and signs of the columns: far from the start are {values}."
            parts.insert(0, wrapped(sentence, WIDTH))
        if self.correlated:
            rows = [(one, other, f"{value:.3f}") for one, other, value in self.correlated]
            parts.append(Table(("correlated", "with", "coefficient"), tuple(rows)))
        factor = f"widen them by a factor of up to {self.coloured:.2g}"
        widened = factor if self.coloured > _WIDENED else "do not widen them"
        parts.append(f"The bands are 95 % bands. Colored residuals {widened}.")
        coloured = [name for name, quantity in self.quantities.items() if quantity.white < WHITE]
        if coloured:
            sentence = f"The residuals of {', '.join(coloured)} are colored."
            parts.append(wrapped(sentence, WIDTH))
        between = "held" if self.inputs == "steps" else "linear"
        title = f"{self.first_line}\nIdentification of {self.model.title}, inputs {between} between"
        title += f" samples{', the likelier of both fits' * self.is_chosen}"
        estimates = [
            (name, estimate.value, estimate.low, estimate.high, estimate.start, estimate.unit)
            for name, estimate in self.parameters.items()
        ]
        rows_of_file = Table(("parameter", "value", "low", "high", "start", "unit"), estimates)
        return Report(title, tuple(parts), further, self.to_dict(), rows_of_file)

    def _estimates(self) -> Table:
        """Return a table of the estimates and their bands."""
        rows = []
        for name, estimate in self.parameters.items():
            half_width = 0.5 * (estimate.high - estimate.low)
            band = f"{100.0 * half_width / abs(estimate.value):.2g} %" if estimate.value else "-"
            ends = [
                shown_value(value, estimate.unit)
                for value in (estimate.value, estimate.low, estimate.high)
            ]
            before = shown_value(estimate.start, estimate.unit)
            rows.append((name, *ends, band, before, shown_unit(estimate.unit)))
        return Table(
            ("parameter", "estimate", "low", "high", "band", "before", "unit"), tuple(rows)
        )

    def _explained(self) -> Table:
        """Return a table of the quality of the fit of each measured quantity."""
        rows = []
        for name, quantity in self.quantities.items():
            noise = beside_unit(shown_value(quantity.noise, quantity.unit), quantity.unit)
            white = f"{100.0 * quantity.white:.0f} %"
            rows.append((name, f"{100.0 * quantity.fit:.2f} %", noise, white))
        return Table(("measured", "explained", "noise", "white lags"), tuple(rows))

    def figure(self) -> Figure:
        """Return a figure of measured and fitted quantities and their residuals versus time."""

        return identified_figure(self)

    def plot(self) -> np.ndarray:
        """Draw the content of `figure` in a pyplot figure and return its Axes."""

        from hfa_support.reporting.figure import pyplot_figure

        return np.array(identified_figure(self, pyplot_figure).axes)


def identified_figure(
    identified: Identified, make: Callable[[float, float], Figure] = new_figure
) -> Figure:
    """Return a figure with one row for each measured quantity and all records one after another.

    The left panel shows the measured samples and the fitted response. The right panel shows the
    residuals.

    make: function (width, height) -> empty figure, in inches
    """
    names = list(identified.quantities)
    figure = make(10.0, 1.2 + 1.6 * len(names))
    axes = figure.subplots(len(names), 2, sharex=True, squeeze=False)
    begins = np.cumsum([0.0, *(r.time[-1] - r.time[0] for r, _ in identified.fitted)])
    for row, name in enumerate(names):
        unit = identified.model.unit(name)
        factor = 180.0 / np.pi if unit.startswith("rad") else 1.0
        left, right = axes[row]
        # `begins` also contains the end of the last record.
        for (record, y), begin in zip(identified.fitted, begins, strict=False):
            if name not in record.measured:
                continue
            time = record.time - record.time[0] + begin
            measured = factor * record.measured[name]
            fitted = factor * y[:, row]
            left.plot(time, measured, ".", color="0.6", markersize=2.0, label="measured")
            left.plot(time, fitted, color="C0", linewidth=1.2, label="fitted")
            right.plot(time, measured - fitted, color="C3", linewidth=0.6)
        left.set_ylabel(f"{name},\n{shown_unit(unit)}")
        right.set_ylabel(shown_unit(unit))
    left, right = axes[0]
    left.set_title("measured and fitted")
    right.set_title("residual: measured - fitted")
    handles, labels = left.get_legend_handles_labels()
    shown = dict(zip(labels, handles, strict=True))  # one entry for all records
    title = f"{identified.model.title}: {', '.join(identified.records)}"
    figure.legend([*shown.values()], [*shown], loc="outside upper center", ncols=2, title=title)
    for bottom in axes[-1]:
        bottom.set_xlabel("time, s")
    return figure


def aircraft_text(identified: Identified, folder: Path) -> str:
    """Return the TOML text of a file with the estimates, bands and covariance.

    The file names the aircraft, relative to its own folder, and the aircraft's SHA-256.
    [parameters] contains the estimates and all other values that differ from the aircraft's own.
    Estimated biases of columns are in [sensors]. [covariance] is omitted if it is not finite.

    folder: folder of the file

    Raises BadInputError if the model was not loaded from a file.
    """
    source = identified.model.source
    if not source.text:
        raise BadInputError(
            "-o FILE.toml requires an aircraft that was read from a file; add --aircraft FILE"
        )
    estimated = [name for name in identified.parameters if name in identified.model.parameters]
    biases = [name for name in identified.parameters if name not in estimated]
    usual = load_model(source.text).parameters
    values = {
        name: signal.start
        for name, signal in identified.model.parameters.items()
        if name in estimated or signal.start != usual[name].start
    }
    # JSON strings are valid TOML.
    rows = [f"aircraft = {json.dumps(relative_to(source.text, folder), ensure_ascii=False)}"]
    rows += [f'sha256 = "{source.digest}"', "", "[parameters]"]
    rows += [f"{name} = {value!r}" for name, value in values.items()]
    rows += ["", "# Ends of the 95 % bands.", "[bands]"]
    rows += [
        f"{name} = [{estimate.low!r}, {estimate.high!r}]"
        for name, estimate in identified.parameters.items()
    ]
    if biases:
        rows += ["", "# Biases of the columns of the records.", "[sensors]"]
        rows += [f"{name} = {identified.parameters[name].value!r}" for name in biases]
    places = [list(identified.parameters).index(name) for name in estimated]
    covariance = identified.covariance[np.ix_(places, places)]
    if np.isfinite(covariance).all():
        rows += [
            "",
            "# Covariance of the parameters, for --draws.",
            "[covariance]",
            f"names = {estimated!r}",
        ]
        rows += ["rows = [", *(f"    {row!r}," for row in covariance.tolist()), "]"]
    return "\n".join(rows) + "\n"
