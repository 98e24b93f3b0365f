"""The verdict on a critic, and what it says."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.critic.critic import Critic
from controller.game.basis import basis
from controller.game.learning_result import LearningResult, settled_at
from controller.riccati.cost import FlightCost
from controller.riccati.gare import Solution
from controller.riccati.margins import DiskMargin
from hfa_support.errors import BadInputError
from hfa_support.jsonable import finite_or_none, jsonable
from hfa_support.reporting.checks import Check, Checked, checks_block, verdict_text
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.report import Part, Report, Reported
from hfa_support.reporting.text import Table, entry_rows, numbered
from hfa_support.reporting.unit_system import entries_in_force, in_force, unit_in_force
from verification.critic.critic_errors import Box, relative_error

if TYPE_CHECKING:
    from matplotlib.axes import Axes
    from matplotlib.figure import Figure

    from controller.riccati.discrete import DiscountedSolution
    from verification.critic.network_check import NetworkSearch

#: What is computed at each time of a history, and the head of its column and curve.
HISTORY = {
    "P_rel_error": "error of P",
    "K_rel_error": "error of K",
    "riccati_residual": "Riccati residual",
    "largest_error": "largest error",
}
#: Rows of a history, and entries of P and K in a report, in that of a critic that fails; files have
#: all.
_TIMES, SHOWN, SHOWN_OF_A_FAILURE = 9, 12, 3
#: Failures with their reasons; the rest by name.
FAILURES = 6
#: Difference of an entry, and cost lost (percent), that are rounding.
_ROUNDING = 1e-9
SCHEMA = "hfa.critic-check/1"


@dataclass(frozen=True, eq=False)
class HistoryErrors:
    """times: (N,), s. errors: (N,) each, by the names of `HISTORY`: Frobenius norms in the units of
    the game, the Riccati residual, and the largest of all errors that the verdict on a critic has.
    Those of P are nan where only a gain is known. limit: of the errors. predefined_time: T_w, s,
    None when none is promised."""

    times: np.ndarray
    errors: dict[str, np.ndarray]
    limit: float
    predefined_time: float | None = None

    @property
    def settling_time(self) -> float:
        """First time from which the largest error stays within the limit, s; inf when the last one
        does not."""
        return settled_at(self.times, self.errors["largest_error"], self.limit)

    @property
    def said(self) -> str:
        """When it settles, in words."""
        if math.isfinite(self.settling_time):
            return (
                f"the largest error stays within {self.limit:g} from {self.settling_time:.4g} s on"
            )
        last = self.errors["largest_error"][-1]
        return f"the largest error ends at {last:.3g} and does not settle within {self.limit:g}"

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        promised = self.predefined_time
        return {
            "time": self.times,
            **self.errors,
            "limit": self.limit,
            "settling_time": finite_or_none(self.settling_time),
            "predefined_time": promised,
            "predefined_time_kept": None if promised is None else self.settling_time <= promised,
        }


@dataclass(frozen=True, eq=False, repr=False)
class CriticCheck(Checked, Reported):
    """The verdict on one critic.

    exact: the certified solution. candidate: what was checked, of a network its linearization.
    diagnosis: the mistake recognized, or "". lost: the largest cost lost, percent, of the linear
    loop and of a network that was flown. learned_margin, exact_margin: disk margins of both gains,
    None for one that does not stabilize. flight: what the critic costs. box: of the states over
    which V, its slopes and the policies were compared. history: the errors over time, of a history.
    network: what was searched of a network. run: of a law. predefined_time: T_w, s. discount, dt
    (s): of the discounted problem in discrete time, which has no margins, flight and box."""

    exact: Solution | DiscountedSolution
    candidate: Critic
    checks: tuple[Check, ...]
    diagnosis: str
    lost: float
    learned_margin: DiskMargin | None = None
    exact_margin: DiskMargin | None = None
    flight: FlightCost | None = None
    box: Box | None = None
    history: HistoryErrors | None = None
    network: NetworkSearch | None = None
    run: LearningResult | None = None
    predefined_time: float | None = None
    discount: float | None = None
    dt: float | None = None

    @property
    def P_rel_error(self) -> float:
        """|P - P*| / |P*|, Frobenius norms in the units of the game; nan when only a gain was
        given."""
        return self._value_of("P_rel_error")

    @property
    def K_rel_error(self) -> float:
        """|K - K*| / |K*|, Frobenius norms in the units of the game."""
        return self._value_of("K_rel_error")

    def holds(self, limit_cost: float | None = None) -> bool:
        """Whether every check holds, or with a limit, percent, whether the critic costs no more."""
        return self.ok if limit_cost is None else self.lost <= limit_cost

    @property
    def largest_error(self) -> float:
        """Of all that have the limit of errors."""
        return max(check.value for check in self.checks if check.limit == self.checks[0].limit)

    def _value_of(self, name: str) -> float:
        return next((check.value for check in self.checks if check.name == name), math.nan)

    def to_dict(self) -> dict[str, Any]:
        """Ready for JSON."""
        candidate, exact = self.candidate, self.exact
        data: dict[str, Any] = {
            "schema": SCHEMA if self.dt is None else "hfa.discounted-check/1",
            "ok": self.ok,
            "P_rel_error": self.P_rel_error,
            "K_rel_error": self.K_rel_error,
            "diagnosis": self.diagnosis,
            "checks": [check.to_dict() for check in self.checks],
            "P": candidate.P,
            "K": candidate.K,
            "P_exact": exact.P,
            "K_exact": exact.K,
        }
        if self.dt is not None:
            data |= {"discount": self.discount, "dt": self.dt, "cost_lost_worst_percent": self.lost}
        else:
            margins = {"disk_margin": self.learned_margin, "disk_margin_exact": self.exact_margin}
            data |= {name: margin and margin.disk for name, margin in margins.items()}
        parts = {
            "graded": self.flight,
            "box": self.box,
            "history": self.history,
            "network": self.network,
        }
        data |= {name: part.to_dict() for name, part in parts.items() if part is not None}
        return dict(jsonable(data))

    def report(
        self,
        states: tuple[str, ...] = (),
        inputs: tuple[str, ...] = (),
        origin: str = "the plant",
        state_units: tuple[str, ...] = (),
        input_units: tuple[str, ...] = (),
        *,
        limit_cost: float | None = None,
    ) -> Report:
        """The verdict in the first line, every check, margins and cost next to the exact ones, P
        and K entry by entry.

        states, inputs: names, by default x1, x2, ... and u1, u2, ...; limit_cost: percent, then
        decides the verdict. state_units, input_units: "" where they are not known."""
        m, n = self.exact.K.shape
        states, inputs = states or numbered("x", n), inputs or numbered("u", m)
        if (len(states), len(inputs)) != (n, m):
            raise BadInputError(
                f"names are given of {len(states)} states and {len(inputs)} inputs; there are {n} and {m}"
            )
        P, units = self.candidate.P, (state_units or ("",) * n, input_units or ("",) * m)
        both = () if P is None else (P, self.exact.P)
        rows = entry_rows(both, (self.candidate.K, self.exact.K), (states, inputs), units)
        records = Table(("matrix", "row", "column", "learned", "exact", "unit"), rows)
        problem = "game solution"
        if self.dt is not None:
            problem = f"solution of the discounted game, discount {self.discount:g} a step of {self.dt:g} s"
        reason = [f"Reason: {self.diagnosis}"] * bool(self.diagnosis)
        parts: list[Part] = [
            (f"Critic on {origin}, against the exact {problem}", *reason),
            checks_block(self.checks) if self.ok else _failures(self.checks),
        ]
        if self.flight is None:
            parts.append(
                "L2 gain, margins and the box of states belong to continuous time and are not checked"
            )
        else:
            assert self.box is not None
            parts += [*[f"Box of states: {self.box.about}"] * self.ok, _flight(self)]
        if (history := self.history) is not None:
            columns = np.column_stack([history.times, *history.errors.values()])
            records = Table(("time [s]", *history.errors), columns)  # type: ignore[arg-type]
            some = np.unique(np.linspace(0, len(columns) - 1, _TIMES).round().astype(int))
            shown = [
                (f"{time:.4g}", *map(_shown, errors)) for time, *errors in columns[some].tolist()
            ]
            parts.append((Table(("time, s", *HISTORY.values()), shown), history.said))
        if self.network is not None:
            parts.append(self.network.said)
        parts.append(_worst(self, rows, states, SHOWN if self.ok else SHOWN_OF_A_FAILURE))
        data = {"state_units": list(state_units), "input_units": list(input_units)} | _data(
            self, limit_cost
        )
        return Report(_verdict(self, limit_cost), parts, data=data, records=records)


def checks_report(
    checks: Mapping[str, CriticCheck], origin: str, limit_cost: float | None = None
) -> Report:
    """Several critics of one game side by side, by the names of their files; limit_cost: as in
    `CriticCheck.report`."""
    errors = ("error of P", "error of K", "largest error")
    header = ("critic", "verdict", *errors, "stabilizing", "cost lost, percent", "L2 gain")
    rows = [
        (
            name,
            verdict_text(check.holds(limit_cost)),
            *map(_shown, (check.P_rel_error, check.K_rel_error, check.largest_error)),
            "yes" if check.learned_margin is not None else "no",
            f"{0.0 if check.lost < _ROUNDING else check.lost:.3g}",
            f"{check.flight.gain:.4g}" if check.flight is not None else "",
        )
        for name, check in checks.items()
    ]
    passed = sum(check.holds(limit_cost) for check in checks.values())
    limits = () if limit_cost is None else (f"Decided by the cost limit {limit_cost:g} percent",)
    reasons = tuple(
        f"{name}: {check.diagnosis}" for name, check in checks.items() if check.diagnosis
    )
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


def _shown(value: float) -> str:
    return "" if math.isnan(value) else f"{value:.3g}"


def _verdict(check: CriticCheck, limit_cost: float | None) -> str:
    """Which limit decided, exact or not, stabilizing or not, cost lost, L2 gain and the likely
    mistake, in one line."""
    named = {each.name: each for each in check.checks}
    limit, failed = named["K_rel_error"].limit, [each for each in check.checks if not each.ok]
    decided = (
        f"the error limit {limit:g}" if not failed or failed[0].limit == limit else failed[0].name
    )
    decided = decided if limit_cost is None else f"the cost limit {limit_cost:g} percent"
    error = next((each for each in failed if each.limit == limit), None)
    stable = named["control_loop_abscissa" if check.dt is None else "control_loop_radius"].ok
    cost = "no cost lost" if check.lost < _ROUNDING else f"cost lost {check.lost:.2g} percent"
    said = [
        f"exact within {limit:g}"
        if error is None
        else f"not exact ({error.reason.partition(':')[0]})",
        "stabilizing" if stable else "not stabilizing",
        cost if math.isfinite(check.lost) else "cost without bound",
    ]
    if "l2_gain" in named and math.isfinite(named["l2_gain"].value):
        said.append(f"L2 gain {named['l2_gain'].value:.4g} (delta {named['l2_gain'].limit:g})")
    mistake = f"; most likely: {check.diagnosis}" if check.diagnosis else ""
    return f"{verdict_text(check.holds(limit_cost))} by {decided}: {', '.join(said)}{mistake}"


def _failures(checks: tuple[Check, ...]) -> Part:
    """What failed and why, a line each: the loops, P and K, then the other errors; the rest in one
    line."""

    def order(check: Check) -> tuple[bool, bool]:
        return check.name.endswith("_error"), check.name not in ("P_rel_error", "K_rel_error")

    failed = sorted((check for check in checks if not check.ok), key=order)
    lines = [
        f"FAIL {check.name}: {check.reason} (must be {check.relation} {check.limit:.3g})"
        for check in failed
    ]
    more = (
        [f"FAIL too: {', '.join(check.name for check in failed[FAILURES:])}"]
        if len(failed) > FAILURES
        else []
    )
    passed = len(checks) - len(failed)
    return (*lines[:FAILURES], *more, f"{passed} check{'s' * (passed != 1)} passed; --json has all")


def _worst(
    check: CriticCheck, entries: list[tuple[Any, ...]], states: tuple[str, ...], most: int
) -> Part:
    """The `most` entries that are farthest off, each relative to the largest of its matrix, in
    their order; and a line that says so where there are more."""
    largest = {
        "P": float(np.abs(check.exact.P).max()) or 1.0,
        "K": float(np.abs(check.exact.K).max()) or 1.0,
    }
    rows = [row for row in entries if row[0] == "K" or states.index(row[1]) <= states.index(row[2])]
    off = np.array([abs(learned - exact) / largest[name] for name, _, _, learned, exact, _ in rows])
    off[off < _ROUNDING] = 0.0  # which of them are the largest is chance
    shown: list[tuple[str, ...]] = []
    for place in sorted(np.argsort(-np.nan_to_num(off, nan=np.inf), kind="stable")[:most]):
        name, row, column, learned, exact, unit = rows[place]
        left, right = in_force(learned, unit), in_force(exact, unit)
        shown.append(
            (f"{name}({row}, {column})", f"{left:.8g}", f"{right:.8g}", f"{left - right:+.2e}")
        )
    left_out = [f"the {most} of {len(rows)} entries that are farthest off; -o FILE has all"] * (
        len(rows) > most
    )
    return (Table(("entry", "learned", "exact", "difference"), shown), *left_out)


def _flight(check: CriticCheck) -> Table:
    flight, margin, exact = check.flight, check.learned_margin, check.exact_margin
    assert flight is not None
    rows = [
        ("cost lost, worst start, percent", f"{flight.worst:.3g}", "0"),
        ("cost lost, mean over starts, percent", f"{flight.mean:.3g}", "0"),
        ("L2 gain", f"{flight.gain:.4g}", f"{flight.exact_gain:.4g}"),
        ("distance to instability", f"{flight.distance:.3g}", f"{flight.exact_distance:.3g}"),
    ]
    for said, name in (("disk", "disk"), ("gain", "gain"), ("phase, deg", "phase"))[
        : 3 if check.ok else 1
    ]:
        learned = "-" if margin is None else f"{getattr(margin, name):.4g}"
        rows.append((f"margin of all inputs, {said}", learned, f"{getattr(exact, name):.4g}"))
    return Table(("in flight, under the worst disturbance", "learned", "exact"), rows)


def _data(check: CriticCheck, limit_cost: float | None) -> dict[str, Any]:
    data = check.to_dict()
    if limit_cost is not None and "graded" in data:
        data["graded"] |= {"limit_cost_percent": limit_cost, "ok": check.holds(limit_cost)}
    return data


#: Entries below this share of the largest are drawn on a linear scale.
_LINEAR_SHARE = 1e-4
#: Errors below this are drawn here: a logarithmic axis has no 0. The axis begins here where an
#: error is rounding, below the other number, whose size differs from machine to machine.
_FLOOR, _ROUNDED = 1e-17, 1e-12


def check_figure(
    check: CriticCheck,
    states: tuple[str, ...],
    inputs: tuple[str, ...],
    origin: str = "the plant",
    state_units: tuple[str, ...] = (),
    input_units: tuple[str, ...] = (),
) -> Figure:
    """P learned, exact and their relative difference as heat maps (signed logarithmic scale), K
    where there is no P; of a run also residual and error over time, of a history all its errors.
    origin: what the plant is called."""
    run, history, exact_P = check.run, check.history, check.exact.P
    curves, times = dict[str, np.ndarray](), np.empty(0)
    if run is not None:
        times, values = run.times, map(basis(run.basis, len(exact_P)).matrix, run.weights)
        curves = {"residual |e| / |z'Qz|": run.residual_norm}
        curves["error |P - P exact| / |P exact|"] = np.array(
            [relative_error(P, exact_P) for P in values]
        )
    elif history is not None:
        times, curves = (
            history.times,
            {said: history.errors[each] for each, said in HISTORY.items()},
        )
    figure = new_figure(12.0, 7.6 if curves else 4.2)
    figure.suptitle(
        f"Critic on {origin}, against the exact game solution: {verdict_text(check.ok)}"
    )
    grid = figure.add_gridspec(2 if curves else 1, 3)
    name, rows, learned, exact, axis_units = (
        "P",
        states,
        check.candidate.P,
        exact_P,
        ((state_units, -1),) * 2,
    )
    if learned is None:
        name, rows, learned, exact = "K", inputs, check.candidate.K, check.exact.K
        axis_units = (input_units, 1), (state_units, -1)
    if state_units:
        learned, exact = (entries_in_force(each, *axis_units) for each in (learned, exact))
    largest = float(np.abs(exact).max())
    with np.errstate(
        divide="ignore", invalid="ignore"
    ):  # no relative difference where the exact entry is 0
        relative = np.ma.masked_invalid((learned - exact) / np.abs(exact))
    maps = ((f"{name} learned", learned, largest), (f"{name} exact", exact, largest))
    for index, (title, entries, size) in enumerate(
        (*maps, ("(learned - exact) / |exact|", relative, None))
    ):
        axes = figure.add_subplot(grid[0, index])
        _heat_map(figure, axes, title, entries, size)
        axes.set_xticks(range(len(states)), states, rotation=60, ha="right", fontsize=7)
        axes.set_yticks(range(len(rows)), rows, fontsize=7)
        if state_units and size is not None:
            axes.set_xlabel(
                f"of states in {', '.join(dict.fromkeys(map(unit_in_force, state_units)))}",
                fontsize=7,
            )
    if curves:
        axes = figure.add_subplot(grid[1, :])
        if history is not None:
            axes.axhline(history.limit, color="C3", linewidth=0.8, label=f"limit {history.limit:g}")
        _over_time(axes, times, curves, check.predefined_time)
    return figure


def checks_figure(checks: Mapping[str, CriticCheck], origin: str) -> Figure:
    """Errors and cost lost of several critics in their order: a learning curve, where they are
    checkpoints."""
    figure = new_figure(12.0, 4.2)
    figure.suptitle(f"Critics on {origin}, against the exact game solution")
    axes, places = figure.add_subplot(), np.arange(len(checks))
    rows = [
        (each.P_rel_error, each.K_rel_error, each.largest_error, each.lost / 100.0)
        for each in checks.values()
    ]
    said = ("error of P", "error of K", "largest error", "cost lost, of the optimum")
    _over_time(axes, places, dict(zip(said, np.array(rows).T, strict=True)), None)
    axes.set_xlabel("")
    axes.set_xticks(
        places, [Path(name).name for name in checks], rotation=30, ha="right", fontsize=7
    )
    return figure


def _over_time(
    axes: Axes, times: np.ndarray, curves: dict[str, np.ndarray], predefined_time: float | None
) -> None:
    known = {label: values for label, values in curves.items() if not np.all(np.isnan(values))}
    for (label, values), style in zip(known.items(), ("-", "--", "-.", ":"), strict=False):
        axes.semilogy(times, np.maximum(values, _FLOOR), style, label=label)
    if predefined_time is not None:
        axes.axvline(
            predefined_time, color="black", linestyle=":", label=f"T_w = {predefined_time:g} s"
        )
    if any(np.nanmin(values, initial=np.inf) < _ROUNDED for values in known.values()):
        axes.set_ylim(bottom=_FLOOR)
    axes.set_xlabel("time, s")
    axes.set_ylabel("relative size")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)


def _heat_map(
    figure: Figure, axes: Axes, title: str, matrix: np.ndarray, size: float | None
) -> None:
    """size: of the color scale; by default, and when it is 0, the largest entry."""
    from matplotlib.colors import SymLogNorm

    size = size or float(np.ma.filled(np.abs(matrix), 0.0).max()) or 1.0
    norm = SymLogNorm(linthresh=size * _LINEAR_SHARE, vmin=-size, vmax=size)
    image = axes.imshow(matrix, cmap="RdBu_r", norm=norm)
    axes.set_title(title)
    powers = 10.0 ** (np.floor(np.log10(size)) - np.array([0.0, 1.0, 2.0]))
    bar = figure.colorbar(
        image, ax=axes, shrink=0.8, ticks=[*-powers, 0.0, *powers[::-1]], format="%g"
    )
    bar.ax.minorticks_off()
