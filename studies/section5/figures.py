"""Figures 3 to 23 of the paper from new simulations: data of the panels, and their drawing."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_model import INPUTS, LINEAR_STATES
from hfa_model.vectors import INPUT_UNITS, STATE_UNITS
from hfa_support.reporting.figure import new_figure
from studies.section5.claims import flights_of
from studies.section5.configuration import Configuration
from studies.section5.flights import (
    CASE_I,
    CASE_II,
    CERTIFIED,
    CERTIFIED_FF,
    EXACT,
    EXACT_FF,
    INTEGRAL,
    MODIFIED,
    PRINTED,
    FlightPlan,
    FlightRecord,
)
from studies.section5.metrics import TRACKED

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

Flights = Mapping[FlightPlan, FlightRecord]
Values = Callable[[FlightRecord], np.ndarray]
_COMMAND = "command"
_LOST = " (lost at "
#: Fraction of a limit beyond which the limit is drawn, smallest residual that is drawn, and number
#: of labeled weights.
_NEAR = 0.8
_FLOOR = 1e-16
_NAMED = 4
_SYMBOLS = {
    "speed": "V",
    "alpha": "α",
    "pitch": "θ",
    "pitch_rate": "q",
    "dihedral": "η",
    "dihedral_rate": "η'",
}
_WORDS = dict(zip(TRACKED, ("speed", "angle of attack", "dihedral"), strict=True))
_CASES = ("Case I, 15 deg", "Case II, 5 deg")
#: Laws whose learning is drawn.
_LEARNED = (MODIFIED, CERTIFIED)
#: Lines differ in lightness, dashes and width, so that they can be distinguished without color.
_STYLES: dict[str, dict[str, Any]] = {
    _COMMAND: {"color": "black", "linestyle": "--", "linewidth": 1.0, "zorder": 5},
    PRINTED: {"color": "black", "marker": "x", "linestyle": "none", "markersize": 9, "zorder": 6},
    MODIFIED: {"color": "0.65", "linestyle": "-", "linewidth": 3.0},
    CERTIFIED: {"color": "C0", "linestyle": "-", "linewidth": 1.3},
    CERTIFIED_FF: {"color": "navy", "linestyle": "-.", "linewidth": 1.5},
    INTEGRAL: {
        "color": "C1",
        "linestyle": "-",
        "linewidth": 1.3,
        "marker": "o",
        "markersize": 4,
        "markevery": 0.08,
    },
    EXACT: {"color": "C3", "linestyle": ":", "linewidth": 1.8},
    EXACT_FF: {"color": "darkred", "linestyle": (0, (5, 1, 1, 1, 1, 1)), "linewidth": 1.3},
}
#: Styles of lines that are not laws: cases of uncertainty, weights.
_CYCLE: tuple[dict[str, Any], ...] = (
    {"color": "black", "linestyle": "-", "linewidth": 2.2},
    {"color": "C0", "linestyle": "--", "linewidth": 1.6},
    {"color": "C1", "linestyle": "-.", "linewidth": 1.6},
    {"color": "0.55", "linestyle": ":", "linewidth": 2.4},
)
#: Style of the lines in a bundle, which are not distinguished.
_BUNDLE: dict[str, Any] = {"color": "0.8", "linewidth": 0.8, "zorder": 1}


@dataclass(frozen=True, eq=False)
class Line:
    """A line of a panel, or a bundle of lines with one label.

    x: (N,)
    y: (N,), or (N, k) for k lines
    """

    label: str
    x: np.ndarray
    y: np.ndarray


@dataclass(frozen=True, eq=False)
class PlotPanel:
    """A panel of a figure, with one pair of axes.

    y_label: label of the vertical axis, with its unit
    lines: lines of the panel
    scale: "linear", "log" or "symlog"
    marked: (time, label) of vertical lines
    linear_part: fraction of the largest value below which a "symlog" axis is linear
    limits: lowest and highest allowed value, drawn if a line comes near them
    """

    title: str
    y_label: str
    lines: tuple[Line, ...]
    scale: str = "linear"
    marked: tuple[tuple[float, str], ...] = ()
    linear_part: float = 1e-3
    limits: tuple[float, ...] = ()


@dataclass(frozen=True, eq=False)
class PaperFigure:
    """A figure of the paper.

    number: number in the paper
    columns: number of columns of panels
    panels: panels, row by row
    """

    number: int
    title: str
    columns: int
    panels: tuple[PlotPanel, ...]

    @property
    def arrays(self) -> dict[str, np.ndarray]:
        """The x and y values of each line, by a name that contains panel and line."""
        found = {}
        for index, panel in enumerate(self.panels):
            for line in panel.lines:
                name = f"{index:02d} {panel.title} {panel.y_label} / {line.label}"
                found[f"{name} / x"] = line.x
                found[f"{name} / y"] = line.y
        # A "/" would create folders when the archive is unpacked.
        return {re.sub(r"[^\w .,+=()-]", "_", name): values for name, values in found.items()}


@dataclass(frozen=True)
class _Panels:
    """Builder of panels from the records of flights."""

    T_w: float  # predefined time, s, drawn as a vertical line
    by: str = "law"  # property that distinguishes the lines of a panel, "law" or "uncertainty"

    def label(self, record: FlightRecord) -> str:
        """Return the legend label of a flight."""
        dA = record.plan.uncertainty
        name = record.plan.law if self.by == "law" else f"ΔA = {dA:+g} A" if dA else "ΔA = 0"
        return name if record.held else f"{name}{_LOST}{record.lost_at:.2g} s)"

    def marks(self, records: Iterable[FlightRecord] = ()) -> tuple[tuple[float, str], ...]:
        """Return the vertical lines of a panel as (time in s, label)."""
        begins = {
            record.learned_from: record.plan.law for record in records if record.learned_from > 0.0
        }
        # Laws with the same learning have the same time. The shorter name is used for both.
        return (self.T_w, "T_w"), *(
            (time, f"K(t), {name.partition(' +')[0]}") for time, name in begins.items()
        )

    def _of_flights(
        self,
        title: str,
        label: str,
        records: Sequence[FlightRecord],
        values: Values,
        **more: Any,
    ) -> PlotPanel:
        """Return a panel with one line for each flight."""
        drawn = [(self.label(record), record.times, values(record)) for record in records]
        lines = tuple(Line(name, times[: len(value)], value) for name, times, value in drawn)
        return PlotPanel(title, label, lines, **{"marked": self.marks(records)} | more)

    def states(self, state: str, title: str, records: Sequence[FlightRecord]) -> PlotPanel:
        """Return a panel of a state in several flights, as deviation, with its command."""
        row = LINEAR_STATES.index(state)
        label = f"{_SYMBOLS[state]} - trim, {getattr(STATE_UNITS, state)}"
        panel = self._of_flights(title, label, records, _column("states", row))
        longest = max(records, key=lambda record: len(record.times))
        command = Line(_COMMAND, longest.times, longest.commands[:, row])
        return PlotPanel(title, label, (*panel.lines, command), marked=panel.marked)

    def errors(self, records: Sequence[FlightRecord]) -> tuple[PlotPanel, ...]:
        """Return a panel of the tracking error in several flights for each tracked state."""
        found = []
        for state in TRACKED:
            row = LINEAR_STATES.index(state)
            label = f"z{row + 1} = {_SYMBOLS[state]} error, {getattr(STATE_UNITS, state)}"
            found.append(self._of_flights(state, label, records, _column("errors", row)))
        return tuple(found)

    def inputs(
        self, titles: Sequence[str], groups: Sequence[Sequence[FlightRecord]]
    ) -> tuple[PlotPanel, ...]:
        """Return panels of the five inputs, as deviations from the trim."""
        panels = []
        for row, name in enumerate(INPUTS):
            unit = getattr(INPUT_UNITS, name)
            label = name if unit == "1" else f"{name}, {unit}"
            for title, records in zip(titles, groups, strict=True):
                # At first, the values are tens of times larger than later.
                more = {
                    "scale": "symlog",
                    "linear_part": 0.1,
                    "limits": tuple(records[0].limits[:, row].tolist()),
                }
                above = title if row == 0 else ""
                panels.append(
                    self._of_flights(above, label, records, _column("inputs", row), **more)
                )
        return tuple(panels)

    def weights(self, record: FlightRecord, title: str, *, increments: bool = False) -> PlotPanel:
        """Return a panel of the weights W of a critic over time."""
        assert record.critic is not None  # the caller draws learned critics
        weights = record.critic.weights
        order = np.argsort(-np.abs(weights[-1]), kind="stable")
        named = np.sort(order[:_NAMED])
        others = np.sort(order[_NAMED:])
        values = np.diff(weights, axis=0) if increments else weights
        times = record.times[: len(values)]
        powers = record.critic.basis.exponents
        lines = [Line(_monomial(powers[m]), times, values[:, m]) for m in named]
        label = "increments of W in a tick" if increments else "weights W, of z in ft/s, rad"
        bundle = Line(f"the other {len(others)}", times, values[:, others])
        return PlotPanel(title, label, (bundle, *lines), "symlog", self.marks())

    def residuals(self, title: str, records: Sequence[FlightRecord]) -> PlotPanel:
        """Return a panel of the Bellman residual |e|, a cost rate, at the simulated error z."""

        def size(record: FlightRecord) -> np.ndarray:
            return np.maximum(np.abs(record.residual), _FLOOR)

        return self._of_flights(
            title, "|Bellman residual|, cost / s", records, size, scale="log", marked=self.marks()
        )

    def updates(self, title: str, records: Sequence[FlightRecord]) -> PlotPanel:
        """Return a panel of the relative rate of change of the learned weights, 1/s."""

        def speed(record: FlightRecord) -> np.ndarray:
            assert record.critic is not None  # as above
            size = np.linalg.norm(np.diff(record.critic.weights, axis=0), axis=1)
            final = float(np.linalg.norm(record.critic.weights[-1]))
            # A logarithmic axis cannot show 0.
            return np.where(size > 0.0, size / np.diff(record.times) / final, np.nan)

        return self._of_flights(
            title, "|W'| / |W(end)|, 1/s", records, speed, scale="log", marked=self.marks()
        )


def _column(name: str, column: int) -> Values:
    """Return a function from a flight record to one column (N,) of the record's array `name`."""
    return lambda record: getattr(record, name)[:, column]


def _monomial(exponents: np.ndarray) -> str:
    """Return the monomial of a weight as text, for example "z1 z2" or "z4^2"."""
    return " ".join(
        f"z{i + 1}" + (f"^{power}" if power > 1 else "")
        for i, power in enumerate(exponents)
        if power
    )


def figures_of(section: str, configuration: Configuration, flown: Flights) -> Iterator[PaperFigure]:
    """Yield the paper's figures of a section.

    flown: plan -> record of each flight
    """
    T_w = configuration.predefined_time(section)
    law = _Panels(T_w)
    uncertain = _Panels(T_w, "uncertainty")
    if section == "5.1":
        drawn = ((PRINTED, *_LEARNED, CERTIFIED_FF, EXACT_FF), (*_LEARNED, EXACT), _LEARNED)
        groups = [
            [[flown[FlightPlan(angle, name)] for name in laws] for angle in (CASE_I, CASE_II)]
            for laws in drawn
        ]
        each = (zip(records, _CASES, strict=True) for records in zip(*groups[2], strict=True))
        learned = [
            (record, f"{record.plan.law}, {title}") for pairs in each for record, title in pairs
        ]
        yield from _eight_figures(3, "{}", law, _CASES, groups, learned)
    elif section == "5.2":
        shown = [
            flown[FlightPlan(CASE_II, name)]
            for name in (MODIFIED, CERTIFIED, CERTIFIED_FF, INTEGRAL)
        ]
        yield PaperFigure(
            11,
            "State comparison, 5 deg",
            1,
            tuple(law.states(each, each, shown) for each in TRACKED),
        )
        yield PaperFigure(12, "Error comparison, 5 deg", 1, law.errors(shown))
        yield PaperFigure(13, "Control comparison, 5 deg", 1, law.inputs(("",), (shown,)))
    elif section == "5.3":
        group = [
            [flown[plan] for plan in flights_of("every uncertainty", configuration, name)]
            for name in _LEARNED
        ]
        flights = (record for records in zip(*group, strict=True) for record in records)
        learned = [(record, f"{record.plan.law}, {uncertain.label(record)}") for record in flights]
        yield from _eight_figures(
            14, "Model uncertainty and {}, 5 deg", uncertain, _LEARNED, [group] * 3, learned
        )
    else:
        shown = [flown[FlightPlan(CASE_II, name, noise=True)] for name in (*_LEARNED, CERTIFIED_FF)]
        yield PaperFigure(
            22, "Tracking errors under measurement noise, 5 deg", 1, law.errors(shown)
        )
        panels = tuple(law.weights(record, record.plan.law) for record in shown[:2])
        yield PaperFigure(23, "Critic weights under measurement noise, 5 deg", 2, panels)


def _eight_figures(
    first: int,
    title: str,
    panels: _Panels,
    columns: Sequence[str],
    groups: Sequence[Sequence[Sequence[FlightRecord]]],
    learned: Sequence[tuple[FlightRecord, str]],
) -> Iterator[PaperFigure]:
    """Yield eight figures of states, inputs and learning, with two columns each."""

    def panels_in_columns(
        panel: Callable[..., PlotPanel], group: Sequence[Sequence[FlightRecord]]
    ) -> tuple[PlotPanel, ...]:
        return tuple(panel(name, records) for name, records in zip(columns, group, strict=True))

    tracked, steered, learning = groups
    drawn = [
        (f"{_WORDS[state]} tracking", panels_in_columns(partial(panels.states, state), tracked))
        for state in TRACKED
    ]
    drawn += [
        ("control inputs", panels.inputs(columns, steered)),
        ("critic weights", tuple(panels.weights(*each) for each in learned)),
        (
            "critic-weight increments",
            tuple(panels.weights(*each, increments=True) for each in learned),
        ),
        ("Bellman residuals", panels_in_columns(panels.residuals, learning)),
        ("critic weight-update norms", panels_in_columns(panels.updates, learning)),
    ]
    for number, (name, found) in enumerate(drawn, first):
        whole = title.format(name)
        yield PaperFigure(number, whole[0].upper() + whole[1:], 2, found)


def draw(picture: PaperFigure) -> Figure:
    """Return a drawn figure. Panels without their own legend share one legend."""
    rows = -(-len(picture.panels) // picture.columns)
    figure = new_figure(5.4 * picture.columns, 1.0 + (2.2 if rows > 2 else 2.8) * rows)
    title = f"Figure {picture.number}. {picture.title}"
    grid = figure.subplots(rows, picture.columns, squeeze=False, sharex=True)
    labels: dict[str, Any] = {}
    for axes, panel in zip(grid.ravel(), picture.panels, strict=False):
        _draw_panel(axes, panel)
        if axes.get_legend() is None:
            labels = dict(zip(*axes.get_legend_handles_labels()[::-1], strict=True)) | labels
    for axes in grid[-1]:
        axes.set_xlabel("time, s")
    for axes in grid.ravel()[len(picture.panels) :]:
        axes.set_axis_off()
    if not labels:
        figure.suptitle(title, fontsize=10)
        return figure
    columns = min(len(labels), 2 + picture.columns)  # at the top, where there is no caption
    figure.legend(
        labels.values(), labels, loc="outside upper center", ncols=columns, fontsize=9, title=title
    )
    return figure


def _draw_panel(axes: Axes, panel: PlotPanel) -> None:
    largest = max(
        (float(np.nanmax(np.abs(line.y), initial=0.0)) for line in panel.lines), default=0.0
    )
    if panel.scale == "symlog" and largest > 0.0:
        axes.set_yscale("symlog", linthresh=10.0 ** np.floor(np.log10(largest * panel.linear_part)))
    elif panel.scale == "log":
        axes.set_yscale("log")
    for index, line in enumerate(panel.lines):
        style = _STYLES.get(line.label.partition(_LOST)[0], _CYCLE[index % len(_CYCLE)])
        if line.y.ndim == 2:
            axes.plot(line.x, line.y, label=[line.label, *["_"] * (line.y.shape[1] - 1)], **_BUNDLE)
            continue
        axes.plot(line.x, line.y, label=line.label, **style)
    if any(line.y.ndim == 2 for line in panel.lines):  # labeled lines differ between panels
        axes.legend(loc="upper left", bbox_to_anchor=(1.0, 1.0), fontsize=7, frameon=False)
    drawn = np.concatenate([line.y.ravel() for line in panel.lines])
    for limit in panel.limits:
        if np.any(drawn / limit > _NEAR):
            axes.axhline(
                limit, color="black", linestyle=(0, (6, 3)), linewidth=0.7, zorder=0, label="limit"
            )
    for time, _ in panel.marked:
        axes.axvline(time, color="0.4", linewidth=0.9, linestyle=(0, (1, 2)))
    if panel.title and panel.marked:  # panels without a title are below a panel with labels
        times, names = zip(*panel.marked, strict=True)
        top = axes.secondary_xaxis("top")
        top.set_xticks(times, names, fontsize=8)
        top.tick_params(length=0, pad=1)
    axes.set_title(panel.title, fontsize=10)
    axes.set_ylabel(panel.y_label, fontsize=9)
    axes.tick_params(labelsize=8, which="both")
    axes.grid(alpha=0.3)
    axes.margins(x=0.02)
