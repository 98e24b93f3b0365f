"""From flights to the panels that Section 5 shows: tracking, inputs, and how the critic learned."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from hfa_model.vectors import INPUT_UNITS, INPUTS, LINEAR_STATES, STATE_UNITS
from studies.section5.experiment_flights import FlightRecord
from studies.section5.panels import COMMAND, LOST, Line, PlotPanel

#: Below this a logarithmic axis shows nothing: rounding.
FLOOR = 1e-16
#: Weights of a critic that a picture names.
_NAMED = 4
_SYMBOLS = {"speed": "V", "alpha": "α", "pitch": "θ", "pitch_rate": "q", "dihedral": "η", "dihedral_rate": "η'"}


def label_of(record: FlightRecord, by: str) -> str:
    """How a flight is called in a legend: by its "law", or by its "uncertainty"."""
    factor = record.plan.uncertainty
    name = record.plan.law if by == "law" else "ΔA = 0" if factor == 0.0 else f"ΔA = {factor:+g} A"
    return name if record.held else f"{name}{LOST}{record.lost_at:.2g} s)"


def state_panel(title: str, state: str, records: Sequence[FlightRecord], by: str, T_w: float) -> PlotPanel:
    """A state as a deviation from its trim, with its command."""
    row = LINEAR_STATES.index(state)
    lines = [Line(label_of(record, by), record.times, record.states[:, row]) for record in records]
    longest = max(records, key=lambda record: len(record.times))
    lines.append(Line(COMMAND, longest.times, longest.commands[:, row]))
    return PlotPanel(
        title,
        _labelled(f"{_SYMBOLS[state]} - trim", getattr(STATE_UNITS, state)),
        tuple(lines),
        marked=_mark(T_w, records),
    )


def error_panel(title: str, state: str, records: Sequence[FlightRecord], by: str, T_w: float) -> PlotPanel:
    """A tracking error z_i."""
    row = LINEAR_STATES.index(state)
    lines = tuple(Line(label_of(record, by), record.times, record.errors[:, row]) for record in records)
    label = _labelled(f"z{row + 1} = {_SYMBOLS[state]} error", getattr(STATE_UNITS, state))
    return PlotPanel(title, label, lines, marked=_mark(T_w, records))


def beside(
    panel: Callable[..., PlotPanel],
    titles: Sequence[str],
    groups: Sequence[Sequence[FlightRecord]],
    by: str,
    T_w: float,
    *what: str,
) -> tuple[PlotPanel, ...]:
    """A panel for each group of flights, side by side; what: the state, where the panel shows one."""
    return tuple(panel(title, *what, group, by, T_w) for title, group in zip(titles, groups, strict=True))


def input_panels(
    titles: Sequence[str], groups: Sequence[Sequence[FlightRecord]], by: str, T_w: float
) -> tuple[PlotPanel, ...]:
    """The five inputs as deviations from trim: one row an input, one column a group of flights."""
    panels = []
    for row, name in enumerate(INPUTS):
        for title, records in zip(titles, groups, strict=True):
            lines = tuple(Line(label_of(record, by), record.times, record.inputs[:, row]) for record in records)
            unit = getattr(INPUT_UNITS, name)
            label, marked = _labelled(name, unit), _mark(T_w, records)
            # The first instants are tens of times larger than the rest.
            limits = tuple(records[0].limits[:, row].tolist())
            panels.append(PlotPanel(title if row == 0 else "", label, lines, "asinh", marked, 0.1, limits))
    return tuple(panels)


def weights_panel(title: str, record: FlightRecord, T_w: float) -> PlotPanel:
    """The weights of the critic, in the units of the model (cost, ft/s, rad): the largest by name."""
    label = "weights W, of z in ft/s, rad"
    return PlotPanel(title, label, _named_lines(record, record.times, _weights(record)), "asinh", _mark(T_w))


def increments_panel(title: str, record: FlightRecord, T_w: float) -> PlotPanel:
    """Increments W(t + tick) - W(t), of the weights that `weights_panel` names too."""
    lines = _named_lines(record, record.times[:-1], np.diff(_weights(record), axis=0))
    return PlotPanel(title, "increments of W in a tick", lines, "asinh", _mark(T_w))


def _weights(record: FlightRecord) -> np.ndarray:
    assert record.critic is not None
    return record.critic.weights


def _named_lines(record: FlightRecord, times: np.ndarray, values: np.ndarray) -> tuple[Line, ...]:
    """The columns of the weights that end largest by their monomials, and all others as one bundle below them."""
    assert record.critic is not None
    order = np.argsort(-np.abs(_weights(record)[-1]), kind="stable")
    named, others = np.sort(order[:_NAMED]), np.sort(order[_NAMED:])
    names = [_monomial(powers) for powers in record.critic.basis.exponents]
    return Line(f"the other {len(others)}", times, values[:, others]), *(
        Line(names[m], times, values[:, m]) for m in named
    )


def _monomial(exponents: np.ndarray) -> str:
    """z1 z2, z4^2: the states of a weight, numbered as the errors are."""
    return " ".join(f"z{i + 1}" + (f"^{power}" if power > 1 else "") for i, power in enumerate(exponents) if power)


def residual_panel(title: str, records: Sequence[FlightRecord], by: str, T_w: float) -> PlotPanel:
    """|e| of the learned value at the simulated error, in units of the cost rate z'Qz."""
    lines = tuple(Line(label_of(one, by), one.times, np.maximum(np.abs(one.residual), FLOOR)) for one in records)
    return PlotPanel(title, "|Bellman residual|, cost / s", lines, "log", _mark(T_w))


def update_panel(title: str, records: Sequence[FlightRecord], by: str, T_w: float) -> PlotPanel:
    """|W(t + tick) - W(t)| / tick over |W| at the end: the relative speed of learning, 1/s."""
    lines = []
    for record in records:
        assert record.critic is not None
        steps = np.diff(record.times)
        size = np.linalg.norm(np.diff(record.critic.weights, axis=0), axis=1)
        final = float(np.linalg.norm(record.critic.weights[-1]))
        speed = np.where(size > 0.0, size / steps / final, np.nan)  # a logarithmic axis has no place for rest
        lines.append(Line(label_of(record, by), record.times[:-1], speed))
    return PlotPanel(title, "|W'| / |W(end)|, 1/s", tuple(lines), "log", _mark(T_w))


def _labelled(name: str, unit: str) -> str:
    return name if unit == "1" else f"{name}, {unit}"


def _mark(T_w: float, records: Sequence[FlightRecord] = ()) -> tuple[tuple[float, str], ...]:
    """T_w, and when the learned gain of a law takes over from the gain it started with."""
    begins = {record.learned_from: record.plan.law for record in records if record.learned_from > 0.0}
    # Laws that share their learning share the time; the shorter name serves for both.
    return ((T_w, "T_w"), *((time, f"K(t), {name.partition(' +')[0]}") for time, name in begins.items()))
