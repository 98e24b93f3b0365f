"""The verdict on a critic, and what it says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.analysis.cost import FlightCost
from controller.game.basis import basis
from controller.game.critic_file import History
from controller.game.learning_result import LearningResult, settled_at
from controller.game.zero_sum import Game
from controller.riccati.balancing import balanced_units, in_units
from controller.riccati.certificate import relative_residual
from controller.riccati.frequency_response import DiskMargin
from controller.riccati.gare import GameSolution
from hfa_support.errors import BadInputError
from hfa_support.jsonable import finite_or_none
from hfa_support.progress import Progress, told
from hfa_support.reporting.checks import Check, Checked, at_most, checks_block, verdict_text
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, entry_rows, numbered
from hfa_support.reporting.unit_system import entries_in_force, in_force, unit_in_force
from verification.critic.candidate import Candidate, from_stored
from verification.critic.critic_errors import Box, critic_errors, relative_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from verification.critic.network_check import NetworkSearch

#: What is computed at each time of a history, and the head of its column.
_HISTORY = {
    "P_rel_error": "error of P",
    "K_rel_error": "error of K",
    "riccati_residual": "Riccati residual",
    "largest_error": "largest error",
}
#: Rows of the table in a report; files have all.
_SHOWN = 9


@dataclass(frozen=True, eq=False)
class HistoryErrors:
    """times: (N,), s. errors: (N,) each: P_rel_error and K_rel_error, Frobenius norms in the units of the game; the
    riccati_residual; the largest_error of all that the verdict on a critic has. Those of P are nan where only a gain is
    known. limit: of the errors. predefined_time: T_w, s, None when none is promised."""

    times: np.ndarray
    errors: dict[str, np.ndarray]
    limit: float
    predefined_time: float | None = None

    @property
    def largest(self) -> np.ndarray:
        """The largest error at each time, (N,)."""
        return self.errors["largest_error"]

    @property
    def settling_time(self) -> float:
        """First time from which the largest error stays within the limit, s; inf when the last one does not."""
        return settled_at(self.times, self.largest, self.limit)

    @property
    def left_again(self) -> tuple[tuple[float, float], ...]:
        """(from, until), s: each spell within the limit that did not last, up to the first time outside."""
        inside = self.largest <= self.limit
        edges = np.flatnonzero(np.diff(np.concatenate([[False], inside, [False]]).astype(int)))
        spells = zip(edges[::2].tolist(), edges[1::2].tolist(), strict=True)
        return tuple((float(self.times[a]), float(self.times[b])) for a, b in spells if b < len(self.times))

    def checks(self) -> tuple[Check, ...]:
        """`settling_time` against the predefined time, where there is one."""
        if self.predefined_time is None:
            return ()
        late = f"{self.said}; T_w is {self.predefined_time:g} s"
        return (at_most("settling_time", self.settling_time, self.predefined_time, late),)

    def block(self) -> Part:
        """The errors at some of the times, evenly spread over the rows, and when they settle."""
        rows = np.unique(np.linspace(0, len(self.times) - 1, _SHOWN).round().astype(int)).tolist()
        shown = [(f"{self.times[row]:.4g}", *(_shown(each[row]) for each in self.errors.values())) for row in rows]
        return (Table(("time, s", *_HISTORY.values()), shown), self.said)

    def records(self) -> Table:
        """One row a time, all digits."""
        rows = np.column_stack([self.times, *self.errors.values()])
        return Table(("time [s]", *self.errors), rows)  # type: ignore[arg-type]

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        promised = self.predefined_time
        return {
            "time": self.times,
            **self.errors,
            "limit": self.limit,
            "settling_time": finite_or_none(self.settling_time),
            "left_again": np.array(self.left_again),
            "predefined_time": promised,
            "predefined_time_kept": None if promised is None else self.settling_time <= promised,
        }

    @property
    def said(self) -> str:
        """When it settles, in words, and whether it had been within the limit before."""
        said = f"the largest error stays within {self.limit:g} from {self.settling_time:.4g} s on"
        if math.isinf(self.settling_time):
            said = f"the largest error ends at {_shown(self.largest[-1])} and does not settle within {self.limit:g}"
        if self.left_again:
            begin, end = self.left_again[-1]
            said += f"; it was within from {begin:.4g} s and left again at {end:.4g} s"
        return said


def history_errors(
    game: Game,
    exact: GameSolution,
    history: History,
    limit: float,
    predefined_time: float | None = None,
    progress: Progress | None = None,
    box: Box | None = None,
) -> HistoryErrors:
    """Every row of a history held against the exact solution, as the verdict holds one critic.

    progress: rows done, rows. box: default `ordinary_box`. BadInputError when a row does not fit the game.
    """
    functions, units = basis(history.basis, len(game.A)), balanced_units(game)
    balanced, squared = in_units(game, units), np.outer(units, units)
    rows = []
    for index in told(range(len(history.times)), progress):
        candidate = from_stored(game, history.row(index), functions)
        errors = {check.name: check.value for check in critic_errors(game, candidate, exact, limit, box)}
        residual = math.nan if candidate.P is None else relative_residual(balanced, candidate.P * squared)
        rows.append((errors.get("P_rel_error", math.nan), errors["K_rel_error"], residual, max(errors.values())))
    columns = dict(zip(_HISTORY, np.array(rows).T, strict=True))
    return HistoryErrors(history.times, columns, limit, predefined_time)


def _shown(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


#: Entries of P and K in a report, and in that of a critic that fails; files have all.
SHOWN, SHOWN_OF_A_FAILURE = 12, 3
#: Failures with their reasons; the rest by name.
FAILURES = 6
_ROUNDING = 1e-9
#: Cost lost that is rounding, percent.
_NO_COST = 1e-9
SCHEMA = "hfa.critic-check/1"


@dataclass(frozen=True, eq=False, repr=False)
class CriticCheck(Checked, Reported):
    """The verdict on one critic.

    exact: the certified solution. candidate: what was checked. learned_margin, exact_margin: disk margins of both
    gains, None for one that does not stabilize. flight: what the critic costs. diagnosis: the mistake recognized, or
    "". box: of the states over which V, its slopes and the policies were compared. history: the errors over time, of
    a history. network: what was searched of a network, whose linearization the candidate is.
    """

    exact: GameSolution
    candidate: Candidate
    checks: tuple[Check, ...]
    learned_margin: DiskMargin | None
    exact_margin: DiskMargin
    flight: FlightCost
    diagnosis: str
    box: Box
    history: HistoryErrors | None = None
    network: NetworkSearch | None = None

    @property
    def P_rel_error(self) -> float:
        """|P - P*| / |P*|, Frobenius norms in the units of the game; nan when only a gain was given."""
        return self._value_of("P_rel_error")

    @property
    def K_rel_error(self) -> float:
        """|K - K*| / |K*|, Frobenius norms in the units of the game."""
        return self._value_of("K_rel_error")

    def holds(self, limit_cost: float | None = None) -> bool:
        """Whether every check holds, or with a limit, percent, whether the critic costs no more, also a network where
        it was flown."""
        if limit_cost is None:
            return self.ok
        return self.lost <= limit_cost

    @property
    def lost(self) -> float:
        """The largest cost lost, percent, of the linear loop and of a network that was flown."""
        return max(self.flight.worst, 0.0 if self.network is None else self.network.lost)

    @property
    def largest_error(self) -> float:
        """Of all that have the limit of errors."""
        return max(check.value for check in self.checks if check.limit == self.checks[0].limit)

    def report(self) -> Report:
        """What the check says, states and inputs by number."""
        return check_report(self)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        candidate = self.candidate
        return {
            "schema": SCHEMA,
            "ok": self.ok,
            "P_rel_error": finite_or_none(self.P_rel_error),
            "K_rel_error": finite_or_none(self.K_rel_error),
            "diagnosis": self.diagnosis,
            "checks": [check.to_dict() for check in self.checks],
            "P": None if candidate.P is None else candidate.P.tolist(),
            "K": candidate.K.tolist(),
            "P_exact": self.exact.P.tolist(),
            "K_exact": self.exact.K.tolist(),
            "disk_margin": None if self.learned_margin is None else self.learned_margin.disk,
            "disk_margin_exact": self.exact_margin.disk,
            "graded": self.flight.to_dict(),
            "box": self.box.to_dict(),
            **({} if self.history is None else {"history": self.history.to_dict()}),
            **({} if self.network is None else {"network": self.network.to_dict()}),
        }

    def _value_of(self, name: str) -> float:
        return next((check.value for check in self.checks if check.name == name), math.nan)


def check_report(
    check: CriticCheck,
    states: tuple[str, ...] = (),
    inputs: tuple[str, ...] = (),
    origin: str = "the plant",
    state_units: tuple[str, ...] = (),
    input_units: tuple[str, ...] = (),
    *,
    limit_cost: float | None = None,
) -> Report:
    """The verdict in the first line, every check, margins and cost next to the exact ones, P and K entry by entry.

    states, inputs: names, by default x1, x2, ... and u1, u2, ...; limit_cost: percent, then decides the verdict.
    state_units, input_units: "" where they are not known.
    """
    m, n = check.exact.K.shape
    states, inputs = states or numbered("x", n), inputs or numbered("u", m)
    for what, names, count in (("states", states, n), ("inputs", inputs, m)):
        if len(names) != count:
            raise BadInputError(f"{len(names)} names of {what} are given; the critic has {count}")
    candidate, exact, units = check.candidate, check.exact, (state_units or ("",) * n, input_units or ("",) * m)
    both = () if candidate.P is None else (candidate.P, exact.P)
    records = Table(
        ("matrix", "row", "column", "learned", "exact", "unit"),
        entry_rows(both, (candidate.K, exact.K), (states, inputs), units),
    )
    parts: tuple[Part, ...] = (
        (
            f"Critic on {origin}, against the exact game solution",
            *[f"Reason: {check.diagnosis}"] * bool(check.diagnosis),
        ),
        checks_block(check.checks) if check.ok else _failures(check.checks),
        *[f"Box of states: {check.box.about}"] * check.ok,
        _flight(check),
        *(() if check.history is None else (check.history.block(),)),
        *(() if check.network is None else (check.network.said,)),
        _worst(check, records, states, SHOWN if check.ok else SHOWN_OF_A_FAILURE),
    )
    units_of = {"state_units": list(state_units), "input_units": list(input_units)}
    records = records if check.history is None else check.history.records()
    return Report(_verdict(check, limit_cost), parts, data=units_of | _data(check, limit_cost), records=records)


def checks_report(checks: Mapping[str, CriticCheck], origin: str, limit_cost: float | None = None) -> Report:
    """Several critics of one game side by side, by the names of their files; limit_cost: as in `check_report`."""
    errors = ("error of P", "error of K", "largest error")
    header = ("critic", "verdict", *errors, "stabilizing", "cost lost, percent", "L2 gain")
    rows = [
        (
            name,
            verdict_text(check.holds(limit_cost)),
            _shown(check.P_rel_error),
            f"{check.K_rel_error:.3g}",
            f"{check.largest_error:.3g}",
            "yes" if check.flight.distance > 0.0 else "no",
            f"{0.0 if check.lost < _NO_COST else check.lost:.3g}",
            f"{check.flight.gain:.4g}",
        )
        for name, check in checks.items()
    ]
    passed = sum(check.holds(limit_cost) for check in checks.values())
    limits = () if limit_cost is None else (f"Decided by the cost limit {limit_cost:g} percent",)
    reasons = tuple(f"{name}: {check.diagnosis}" for name, check in checks.items() if check.diagnosis)
    return Report(
        title=f"{passed} of {len(checks)} critics on {origin} pass against the exact game solution",
        parts=(*limits, Table(header, rows), reasons),
        data={
            "schema": "hfa.critic-checks/1",
            "ok": passed == len(checks),
            "critics": {name: _data(check, limit_cost) for name, check in checks.items()},
        },
        records=Table(header, rows),
    )


def _verdict(check: CriticCheck, limit_cost: float | None) -> str:
    """Which limit decided, exact or not, stabilizing or not, cost lost, L2 gain and the likely mistake, in one line."""
    named = {each.name: each for each in check.checks}
    limit, failed = named["K_rel_error"].limit, next((each for each in check.checks if not each.ok), None)
    decided = f"the error limit {limit:g}" if failed is None or failed.limit == limit else failed.name
    decided = decided if limit_cost is None else f"the cost limit {limit_cost:g} percent"
    error = next((each for each in check.checks if not each.ok and each.limit == limit), None)
    cost = "no cost lost" if check.lost < _NO_COST else f"cost lost {check.lost:.2g} percent"
    said = [
        f"exact within {limit:g}" if error is None else f"not exact ({error.reason.partition(':')[0]})",
        "stabilizing" if named["control_loop_abscissa"].ok else "not stabilizing",
        cost if math.isfinite(check.lost) else "cost without bound",
    ]
    if "l2_gain" in named and math.isfinite(named["l2_gain"].value):
        said.append(f"L2 gain {named['l2_gain'].value:.4g} (delta {named['l2_gain'].limit:g})")
    mistake = f"; most likely: {check.diagnosis}" if check.diagnosis else ""
    return f"{'PASS' if check.holds(limit_cost) else 'FAIL'} by {decided}: {', '.join(said)}{mistake}"


def _failures(checks: tuple[Check, ...]) -> Part:
    """What failed and why, a line each: the loops, P and K, then the other errors; the rest in one line."""

    def order(check: Check) -> tuple[bool, bool]:
        return check.name.endswith("_error"), check.name not in ("P_rel_error", "K_rel_error")

    failed = sorted((check for check in checks if not check.ok), key=order)
    lines = [f"FAIL {check.name}: {check.reason} (must be {check.relation} {check.limit:.3g})" for check in failed]
    more = [f"FAIL too: {', '.join(check.name for check in failed[FAILURES:])}"] if len(failed) > FAILURES else []
    passed = len(checks) - len(failed)
    return (*lines[:FAILURES], *more, f"{passed} check{'s' * (passed != 1)} passed; --json has all")


def _worst(check: CriticCheck, entries: Table, states: tuple[str, ...], most: int) -> Part:
    """The `most` entries that are farthest off, each relative to the largest of its matrix, in their order; and a line
    that says so where there are more."""
    largest = {"P": float(np.abs(check.exact.P).max()) or 1.0, "K": float(np.abs(check.exact.K).max()) or 1.0}
    rows = [row for row in entries.rows if row[0] == "K" or states.index(row[1]) <= states.index(row[2])]
    off = np.array([abs(learned - exact) / largest[name] for name, _, _, learned, exact, _ in rows])
    off[off < _ROUNDING] = 0.0  # which of them are the largest is chance
    kept = sorted(np.argsort(-np.nan_to_num(off, nan=np.inf), kind="stable")[:most].tolist())
    shown: list[tuple[str, ...]] = []
    for name, row, column, learned, exact, unit in (rows[place] for place in kept):
        left, right, difference = (in_force(value, unit) for value in (learned, exact, learned - exact))
        shown.append((f"{name}({row}, {column})", f"{left:.8g}", f"{right:.8g}", f"{difference:+.2e}"))
    left_out = [f"the {most} of {len(rows)} entries that are farthest off; -o FILE has all"] * (len(rows) > most)
    return (Table(("entry", "learned", "exact", "difference"), shown), *left_out)


def _flight(check: CriticCheck) -> Table:
    flight, margin, exact = check.flight, check.learned_margin, check.exact_margin
    rows = [
        ("cost lost, worst start, percent", f"{flight.worst:.3g}", "0"),
        ("cost lost, mean over starts, percent", f"{flight.mean:.3g}", "0"),
        ("L2 gain", f"{flight.gain:.4g}", f"{flight.exact_gain:.4g}"),
        ("distance to instability", f"{flight.distance:.3g}", f"{flight.exact_distance:.3g}"),
    ]
    for said, name in (("disk", "disk"), ("gain", "gain"), ("phase, deg", "phase"))[: 3 if check.ok else 1]:
        learned = "-" if margin is None else f"{getattr(margin, name):.4g}"
        rows.append((f"margin of all inputs, {said}", learned, f"{getattr(exact, name):.4g}"))
    return Table(("in flight, under the worst disturbance", "learned", "exact"), rows)


def _data(check: CriticCheck, limit_cost: float | None) -> dict[str, Any]:
    data = check.to_dict()
    if limit_cost is None:
        return data
    limited = {"limit_cost_percent": limit_cost, "ok": check.holds(limit_cost)}
    return data | {"graded": data["graded"] | limited}


#: Entries below this share of the largest are drawn on a linear scale.
_LINEAR_SHARE = 1e-4
#: Errors below this are drawn here: a logarithmic axis has no 0. The axis begins here where an error is rounding, below
#: the other number, whose size differs from machine to machine.
_FLOOR, _ROUNDED = 1e-17, 1e-12


def check_figure(
    check: CriticCheck,
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    origin: str = "the plant",
    state_units: tuple[str, ...] = (),
    input_units: tuple[str, ...] = (),
    *,
    run: LearningResult | None = None,
    predefined_time: float | None = None,
) -> Figure:
    """P learned, exact and their relative difference as heat maps (signed logarithmic scale), K where there is no P; of
    a run also residual and error over time. origin: what the plant is called."""
    over_time = run is not None or check.history is not None
    figure = new_figure(12.0, 7.6 if over_time else 4.2)
    figure.suptitle(f"Critic on {origin}, against the exact game solution: {verdict_text(check.ok)}")
    grid = figure.add_gridspec(2 if over_time else 1, 3)
    name, rows, learned, exact = "P", states, check.candidate.P, check.exact.P
    axis_units = (state_units, -1), (state_units, -1)
    if learned is None:
        name, rows, learned, exact = "K", inputs, check.candidate.K, check.exact.K
        axis_units = (input_units, 1), (state_units, -1)
    if state_units:
        learned, exact = (entries_in_force(each, *axis_units) for each in (learned, exact))
    largest = float(np.abs(exact).max())
    with np.errstate(divide="ignore", invalid="ignore"):  # no relative difference where the exact entry is 0
        relative = np.ma.masked_invalid((learned - exact) / np.abs(exact))
    maps = ((f"{name} learned", learned, largest), (f"{name} exact", exact, largest))
    for index, (title, entries, size) in enumerate((*maps, ("(learned - exact) / |exact|", relative, None))):
        axes = figure.add_subplot(grid[0, index])
        _heat_map(figure, axes, title, entries, size)
        axes.set_xticks(range(len(states)), states, rotation=60, ha="right", fontsize=7)
        axes.set_yticks(range(len(rows)), rows, fontsize=7)
        if state_units and size is not None:
            axes.set_xlabel(f"of states in {', '.join(dict.fromkeys(map(unit_in_force, state_units)))}", fontsize=7)
    history = check.history
    if run is not None:
        matrix = check.candidate.functions.matrix
        errors = np.array([relative_error(matrix(weights), check.exact.P) for weights in run.weights])
        curves = {"residual |e| / |z'Qz|": run.residual_norm, "error |P - P exact| / |P exact|": errors}
        _over_time(figure.add_subplot(grid[1, :]), run.times, curves, predefined_time)
    elif history is not None:
        curves = {
            "Riccati residual": history.errors["riccati_residual"],
            "error |P - P exact| / |P exact|": history.errors["P_rel_error"],
            "error |K - K exact| / |K exact|": history.errors["K_rel_error"],
            "largest error": history.largest,
        }
        axes = figure.add_subplot(grid[1, :])
        axes.axhline(history.limit, color="C3", linewidth=0.8, label=f"limit {history.limit:g}")
        _over_time(axes, history.times, curves, history.predefined_time)
    return figure


def checks_figure(checks: Mapping[str, CriticCheck], origin: str) -> Figure:
    """Errors and cost lost of several critics in their order: a learning curve, where they are checkpoints."""
    figure = new_figure(12.0, 4.2)
    figure.suptitle(f"Critics on {origin}, against the exact game solution")
    axes = figure.add_subplot()
    each = list(checks.values())
    curves = {
        "error |P - P exact| / |P exact|": [check.P_rel_error for check in each],
        "error |K - K exact| / |K exact|": [check.K_rel_error for check in each],
        "largest error": [check.largest_error for check in each],
        "cost lost, of the optimum": [check.lost / 100.0 for check in each],
    }
    places = np.arange(len(each))
    _over_time(axes, places, {label: np.array(values) for label, values in curves.items()}, None)
    axes.set_xlabel("")
    axes.set_xticks(places, [Path(name).name for name in checks], rotation=30, ha="right", fontsize=7)
    return figure


def _over_time(axes: Axes, times: np.ndarray, curves: dict[str, np.ndarray], predefined_time: float | None) -> None:
    known = {label: values for label, values in curves.items() if not np.all(np.isnan(values))}
    for (label, values), style in zip(known.items(), ("-", "--", "-.", ":"), strict=False):
        axes.semilogy(times, np.maximum(values, _FLOOR), style, label=label)
    if predefined_time is not None:
        axes.axvline(predefined_time, color="black", linestyle=":", label=f"T_w = {predefined_time:g} s")
    if any(np.nanmin(values, initial=np.inf) < _ROUNDED for values in known.values()):
        axes.set_ylim(bottom=_FLOOR)
    axes.set_xlabel("time, s")
    axes.set_ylabel("relative size")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def _heat_map(figure: Figure, axes: Axes, title: str, matrix: np.ndarray, size: float | None) -> None:
    """size: of the color scale; by default, and when it is 0, the largest entry."""
    from matplotlib.colors import SymLogNorm

    size = size or float(np.ma.filled(np.abs(matrix), 0.0).max()) or 1.0
    norm = SymLogNorm(linthresh=size * _LINEAR_SHARE, vmin=-size, vmax=size)
    image = axes.imshow(matrix, cmap="RdBu_r", norm=norm)
    axes.set_title(title)
    powers = 10.0 ** (np.floor(np.log10(size)) - np.array([0.0, 1.0, 2.0]))
    bar = figure.colorbar(image, ax=axes, shrink=0.8, ticks=[*-powers, 0.0, *powers[::-1]], format="%g")
    bar.ax.minorticks_off()
