"""Reports of verdicts on critics, with the sentences of their first lines."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.game.linear_game import weights_line
from controller.game.zero_sum import Game
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Check, Report, verdict_text
from hfa_support.reporting.results import Entries
from hfa_support.reporting.text import Cell, Table, entry_rows, percent
from verification.box import SHARE
from verification.nonlinear_game import NonlinearComparison
from verification.verdict import NEAR, OPTIMAL, Verdict, values_text

if TYPE_CHECKING:
    from matplotlib.figure import Figure


#: Number of entries of P and K in a report, and in the report of a critic that fails. Files contain
#: all entries.
_ENTRIES = 12
_ENTRIES_OF_A_FAILURE = 3
#: Relative difference of an entry that its eight printed digits show.
_SHOWN = 1e-8
#: Number of failures printed with their reasons; of further ones only the names are printed.
_FAILURES = 6
#: Kinds of checks that the first lines always mention. Another failed check is told by its reason.
_KINDS_IN_FIRST_LINES = ("error", "rest", "stability", "game loop")
#: Checks of the gain K.
_OF_K = ("K_rel_error", "K_balanced_error", "K_entry_error")
#: What to compare if no mistake is recognized.
_UNEXPLAINED = (
    "Compare signs, units and order of states and inputs, Q, R, delta, discount and dt "
    "with those of the training"
)
#: Largest number of columns of the first line of a report.
_FIRST_LINE = 80


def verdict_report(
    verdict: Verdict,
    *,
    limit_cost: float | None = None,
    about: Sequence[str] = (),
    source: str = "",
) -> Report:
    """Return a report of the verdict: first lines, checks, sections, and entries of P and K.

    limit_cost: as for `holds`
    about: lines below the heading, instead of the weights of the game
    source: file of the critic, or "" if there is none
    """
    names = verdict.exact.names
    P = verdict.critic.P
    values = () if P is None else (P, verdict.exact.P)
    entries = entry_rows(values, (verdict.critic.K, verdict.exact.K), names)
    records = Table(("matrix", "row", "column", "learned", "exact", "unit"), entries)
    words = game_words(verdict.exact.game)
    critic = f"Critic of {source}" if source else "Critic"
    heading = [f"{critic} on {names.origin}, against the exact {words.solution}"]
    heading += about or (weights_line(verdict.exact.game),)
    heading += (note for note in verdict.critic.declared.notes if note != verdict.reason)
    wrong = {check.name for check in verdict.checks if check.kind == "error" and not check.ok}
    if verdict.critic.network:  # only a wrong K, of a critic that fails, may be of another game
        wrong = wrong & {*_OF_K} if verdict.grade == "fail" else set()
    if verdict.reason:
        where = "" if verdict.nonlinear is None else f", on the {words.game}"
        heading.append(f"Reason{where}: {verdict.reason}")
    elif wrong:
        heading.append(_UNEXPLAINED)
    return Report(
        "\n".join(_first_lines(verdict, limit_cost, words.game)),
        [
            tuple(heading),
            checks_part(verdict.checks),
            *(section.part for section in verdict.sections),
            _farthest_entries(verdict, entries, names.states),
        ],
        data=Entries(
            {"state_units": names.state_units, "input_units": names.input_units},
            partial(verdict.file_entries, limit_cost),
        ),
        records=records,
    )


class GameWords(NamedTuple):
    """A game and its exact solution in words: "linear game", and "game solution"."""

    game: str
    solution: str


def game_words(game: Game) -> GameWords:
    """Return the words for a game in the first line and the heading of a verdict."""
    if not game.is_discrete:
        return GameWords("linear game", "game solution")
    solution = "solution of the game in discrete time"
    if game.discount != 1.0:
        solution += f", discount {game.discount:g} a step"
    if game.dt is True:  # steps of unknown duration
        return GameWords("discrete game", solution)
    return GameWords("sampled game", f"{solution}, steps of {game.dt:g} s")


def _first_lines(verdict: Verdict, limit_cost: float | None, game: str) -> list[str]:
    """Return the headline, a limit of the cost that decides, and a line for further findings.

    game: the kind of game in words
    """
    scope = f"on the {game}, {verdict.box.name}"
    if verdict.nonlinear is not None:
        scope = f"of the linear part on the {game}"
    is_seen = verdict.flights and not verdict.is_proved(limit_cost)
    if is_seen and not verdict.has_counterexample(limit_cost):
        flights = f"{verdict.flights} flight{'' if verdict.flights == 1 else 's'}"
        scope += f", in {flights}, not proved"
    first, second, *further = _facts(verdict, limit_cost)
    grade = grade_word(verdict._linear_grade(limit_cost))
    headline = f"{grade} {scope}: {first}"
    if len(headline) + len(second) + 2 <= _FIRST_LINE:
        headline += f", {second}"
    else:
        further = [second, *further]
    lines = [headline, *further]
    if limit_cost is not None:
        lines.insert(1, f"decided by the cost limit {limit_cost:g} %")
    if verdict.nonlinear is not None:
        lines = [*_nonlinear_lines(verdict.nonlinear, grade, limit_cost), *lines]
    return lines


def _facts(verdict: Verdict, limit_cost: float | None) -> list[str]:
    """Return at least two findings, the most important one first."""
    failed = [check for check in verdict.checks if not check.ok]
    exactness = _exactness(verdict, failed)
    # A policy with a nonsmooth point at the trim has no slopes there: its errors come first.
    is_nonsmooth = verdict.critic.is_nonsmooth and bool(failed)
    facts = [exactness] if is_nonsmooth else []
    is_told = verdict.proof is not None or any(
        check.kind in _KINDS_IN_FIRST_LINES for check in failed
    )
    if failed and not is_told:
        # The findings below mention no check of this kind, and would not say why the critic fails.
        facts.append(failed[0].reason)
    if verdict.proof is None:
        facts.append(_cost_text(verdict))
    else:
        facts += _network_facts(verdict, limit_cost)
    if verdict.reason and verdict.reason == verdict.critic.declared.assumed:
        facts.append("by the paper's Q, R, delta, as none are given")
    if not verdict.stabilizing:
        facts.append("not stabilizing")
    if not is_nonsmooth:
        facts.append(exactness)
    if verdict.stabilizing and verdict.proof is None:
        facts.append("stabilizing")
    gain = next((check for check in verdict.checks if check.kind == "gain"), None)
    if gain is not None and math.isfinite(gain.value):
        facts.append(f"L2 gain {gain.value:.4g} (delta {gain.limit:g})")
    return facts


def _nonlinear_lines(
    nonlinear: NonlinearComparison, grade_of_linear_part: str, limit_cost: float | None
) -> list[str]:
    """Return the headline of both games, and a line for each finding on the nonlinear game."""
    flown = nonlinear.flown
    about = "near the trim" if flown is None else f"in {flown.where}"
    headline = (
        f"{grade_word(nonlinear.grade(limit_cost))} on the nonlinear game {about}, "
        f"linear part {grade_of_linear_part}"
    )
    findings = [nonlinear.sentence]
    if flown is not None:
        # The sentence on the flights is first if they decide that the critic fails.
        place = 1 if flown.within(SHARE) else 0
        findings.insert(place, flown.sentence)
    return [headline, *(f"Nonlinear game: {finding}" for finding in findings)]


def _cost_text(verdict: Verdict) -> str:
    """Return the cost of the critic relative to the optimum, as far as it is known, as text."""
    enclosed = verdict.suboptimality
    assert enclosed is not None
    if enclosed.is_optimal:
        return "optimal cost"
    least = percent(100.0 * enclosed.low)
    if enclosed.is_known and not math.isinf(enclosed.low):  # both bounds have the same digits
        return f"{least} above the optimum"
    if enclosed.matrix is None:  # no quadratic form bounds the cost
        return "cost without bound" if math.isinf(enclosed.low) else "cost not decided"
    if math.isinf(enclosed.high):
        return f"cost not decided, at least {least} above the optimum"
    return f"{least} to {percent(100.0 * enclosed.high, up=True)} above the optimum"


def _simulated_text(verdict: Verdict, limit_cost: float | None) -> str:
    """Return what is proved of the cost of a critic, or else what its simulations show, as text."""
    proof, worst, names = verdict.proof, verdict.worst_flight, verdict.exact.names
    assert proof is not None
    simulated = verdict.cost_above_optimum_percent
    if verdict.is_proved(limit_cost) or (not verdict.flights and proof.is_found):
        is_within = verdict.is_proved(limit_cost)
        bound = percent(100.0 * proof.excess, up=True)
        text = f"proved{'' if is_within else ' stable'}, at most {bound} above the optimum"
    elif not verdict.flights:
        return "cost not decided"
    elif math.isnan(simulated):
        return next(check.reason for check in verdict.checks if math.isnan(check.value))
    elif math.isinf(simulated):
        assert worst is not None
        start = values_text(names.states, names.state_units, worst.start)
        game = verdict.exact.game
        what = "cost without bound" if math.isfinite(game.delta) else "not stabilizing"
        return f"{what} from ({start}): {worst.what}"
    elif simulated <= OPTIMAL:
        text = "no flight above the optimum"
    else:
        text = f"at least {percent(simulated)} above the optimum"
        if worst is not None and verdict.has_counterexample(limit_cost):
            text += f" from ({values_text(names.states, names.state_units, worst.start)})"
    is_at_trim = all(check.ok for check in verdict.checks if check.kind == "rest")
    return text if is_at_trim else f"{text} about its equilibrium"


def _network_facts(verdict: Verdict, limit_cost: float | None) -> list[str]:
    """Return the cost, what is proved, the equilibrium (first, if off the trim) and K of a critic
    that is not quadratic.
    """
    proof = verdict.proof
    assert proof is not None
    cost = [_simulated_text(verdict, limit_cost)]
    if not verdict.is_proved(limit_cost) and (verdict.flights or not proof.is_found):
        if proof.is_found:
            bound = percent(100.0 * proof.excess, up=True)
            cost.append(f"proved: stable, at most {bound} above the optimum")
        else:
            cost.append(f"not proved: {proof.left}")
    equilibrium = [
        "equilibrium at the trim" if check.ok else check.reason
        for check in verdict.checks
        if check.kind == "rest"
    ]
    facts = [*cost, *equilibrium] if verdict.rests_within(NEAR) else [*equilibrium, *cost]
    faults_of_K = [check.reason for check in verdict.checks if check.name in _OF_K and not check.ok]
    if faults_of_K:
        return [*facts, faults_of_K[0]]
    return [*facts, f"K exact within {verdict.limit:g}"]


def grade_word(grade: str) -> str:
    """Return PASS, NEAR or FAIL for a grade "exact", "near" or "fail"."""
    return Cell("NEAR", "bad") if grade == "near" else verdict_text(grade == "exact")


def _exactness(verdict: Verdict, failed: Sequence[Check]) -> str:
    """Return whether the critic is exact, as text, for a simulated critic without the errors of K,
    which are a finding of their own (`_network_facts`).
    """
    excluded = () if verdict.proof is None else _OF_K
    errors = (check for check in failed if check.kind == "error" and check.name not in excluded)
    wrong = next(errors, None)
    if wrong is not None:
        if verdict.critic.network and verdict.reason:
            return f"not exact: {verdict.reason}"
        return f"not exact ({wrong.reason})"
    if verdict.searched:
        return f"no error above {verdict.limit:g} found at {verdict.searched} states"
    return f"exact within {verdict.limit:g}"


def _farthest_entries(
    verdict: Verdict, entries: Sequence[tuple[Any, ...]], states: tuple[str, ...]
) -> Part:
    """Return a table of the entries of P and K with the largest errors, or () without errors.

    entries: rows (matrix, row, column, learned, exact, unit)
    """
    largest = {name: np.abs(getattr(verdict.exact, name)).max() or 1.0 for name in "PK"}
    candidates = [  # without the lower triangle of P
        (matrix, row, column, learned, exact)
        for matrix, row, column, learned, exact, _unit in entries
        if matrix == "K" or states.index(row) <= states.index(column)
    ]
    errors = [abs(learned - exact) / largest[matrix] for matrix, _, _, learned, exact in candidates]
    sizes = np.nan_to_num(np.array(errors), nan=np.inf)
    sizes[sizes < _SHOWN] = 0.0  # rounding would determine the largest
    if not sizes.any():
        return ()
    most = _ENTRIES if verdict.ok else _ENTRIES_OF_A_FAILURE
    shown = [candidates[index] for index in sorted(np.argsort(-sizes, kind="stable")[:most])]
    rows = [
        (f"{name}({row}, {column})", f"{given:.8g}", f"{right:.8g}", f"{given - right:+.2e}")
        for name, row, column, given, right in shown
    ]
    table = Table(("entry", "learned", "exact", "difference"), rows)
    if len(candidates) <= most:
        return (table,)
    which = f"the {most} of {len(candidates)} entries with the largest errors"
    return (table, f"{which}; -o FILE writes all")


def checks_part(checks: Sequence[Check]) -> Part:
    """Return a line for each failed check with its reason, and the number of passed checks.

    An error in balanced units or of an entry is left out if that of the whole matrix is named.
    """

    # Errors come last; that of the whole P or K comes before its others.
    def order(check: Check) -> tuple[bool, bool]:
        return check.kind == "error", check.name not in ("P_rel_error", "K_rel_error")

    failed = sorted((check for check in checks if not check.ok), key=order)
    passed = len(checks) - len(failed)
    for matrix in "PK":
        if any(check.name == f"{matrix}_rel_error" for check in failed):
            others = (f"{matrix}_balanced_error", f"{matrix}_entry_error")
            failed = [check for check in failed if check.name not in others]
    lines = [
        f"FAIL {check.name}: {check.reason} (must be {check.relation} {check.limit:.3g})"
        for check in failed[:_FAILURES]
    ]
    if len(failed) > _FAILURES:
        lines.append(f"FAIL too: {', '.join(check.name for check in failed[_FAILURES:])}")
    lines.append(f"{passed} check{'' if passed == 1 else 's'} passed")
    return tuple(lines)


def verdicts_report(verdicts: Mapping[str, Verdict], limit_cost: float | None = None) -> Report:
    """Return a report with a table of several critics of one game.

    verdicts: file -> verdict
    limit_cost: limit of the cost above the optimum, percent. With a limit, only the cost decides
        each verdict. With None, all checks must pass.
    """
    header = (
        "critic",
        "verdict",
        "error of P",
        "error of K",
        "largest error",
        "stabilizing",
        "linear cost, % above the optimum",
        "L2 gain",
    )
    rows = []
    for name, verdict in verdicts.items():
        above = verdict.cost_above_optimum_percent
        # A cost that differs from the optimum by rounding alone is printed as 0.
        above = 0.0 if above <= OPTIMAL else above
        gain = verdict.value_of("l2_gain")
        rows.append(
            (
                name,
                grade_word(verdict._grade(limit_cost)),
                _number_text(verdict.P_rel_error),
                _number_text(verdict.K_rel_error),
                _number_text(verdict.largest_error),
                "yes" if verdict.stabilizing else "no",
                "?" if math.isnan(above) else percent(above, 3).removesuffix(" %"),
                "" if math.isnan(gain) else f"{gain:.4g}",
            )
        )
    passed = sum(verdict.holds(limit_cost) for verdict in verdicts.values())
    ok = passed == len(verdicts)
    origin = next(iter(verdicts.values())).exact.names.origin
    parts: list[Part] = []
    if limit_cost is not None:
        parts.append(f"Decided by the cost limit {limit_cost:g} percent")
    reasons = [f"{name}: {verdict.reason}" for name, verdict in verdicts.items() if verdict.reason]
    return Report(
        title=f"{verdict_text(ok)}: {passed} of {len(verdicts)} critics pass, on {origin}",
        parts=(*parts, Table(header, rows), tuple(reasons)),
        data={
            "schema": "hfa.critic-checks/1",
            "ok": ok,
            "critics": {
                name: verdict.file_entries(limit_cost) for name, verdict in verdicts.items()
            },
        },
        records=Table(header, rows),
    )


def _number_text(value: float) -> str:
    """Return a number as text with three digits, or "" for nan."""
    return "" if math.isnan(value) else f"{value:.3g}"


#: Entries below this fraction of the largest are drawn on a linear scale.
_LINEAR_SHARE = 1e-4
#: Smaller errors are rounding, whose size differs between machines. They are drawn at this value,
#: the lower end of the axis.
_ROUNDED = 1e-12


def verdict_figure(verdict: Verdict, make: Callable[[float, float], Figure] = new_figure) -> Figure:
    """Return a figure with heat maps of a critic's P, the exact P, and their difference.

    For a critic without P, the maps are those of K. They have one color scale, which is symmetric
    logarithmic, and linear near 0.

    verdict: verdict on the critic
    make: function (width, height) -> empty figure, in inches
    """
    from matplotlib.colors import SymLogNorm

    names = verdict.exact.names
    solution = game_words(verdict.exact.game).solution
    name = "K" if verdict.critic.P is None else "P"
    rows = names.inputs if name == "K" else names.states
    learned, exact = getattr(verdict.critic, name), getattr(verdict.exact, name)
    size = float(np.abs(exact).max()) or 1.0
    norm = SymLogNorm(linthresh=size * _LINEAR_SHARE, vmin=-size, vmax=size)
    figure = make(12.5, 4.0)
    title = f"Critic on {names.origin}\nagainst the exact {solution}: {grade_word(verdict.grade)}"
    figure.suptitle(title, fontsize=11)
    maps = {f"{name} learned": learned, f"{name} exact": exact, "learned - exact": learned - exact}
    for axes, (map_title, entries) in zip(figure.subplots(1, 3), maps.items(), strict=True):
        axes.set_title(map_title)
        image = axes.imshow(entries, cmap="RdBu_r", norm=norm, aspect="auto")
        figure.colorbar(image, ax=axes, format="%g").ax.minorticks_off()
        axes.set_xticks(range(len(names.states)), names.states, rotation=60, ha="right", fontsize=7)
        axes.set_yticks(range(len(rows)), rows, fontsize=7)
        if any(names.state_units):
            units = ", ".join(dict.fromkeys(names.state_units))
            per = "inputs per states" if name == "K" else "cost per states squared"
            axes.set_xlabel(f"{per}, states in {units}", fontsize=7)
    return figure


def verdicts_figure(verdicts: Mapping[str, Verdict]) -> Figure:
    """Return a figure of the errors and excess costs of several critics, in their order.

    For a single critic, the result is its `verdict_figure`.

    verdicts: source of each critic -> its verdict
    """
    judged = list(verdicts.values())
    if len(verdicts) == 1:
        return verdict_figure(judged[0])
    figure = new_figure(12.0, 4.2)
    origin = judged[0].exact.names.origin
    figure.suptitle(f"Critics on {origin}, against the exact game solution")
    axes = figure.add_subplot()
    positions = np.arange(len(verdicts))
    curves = {
        "error of P": [verdict.P_rel_error for verdict in judged],
        "error of K": [verdict.K_rel_error for verdict in judged],
        "largest error": [verdict.largest_error for verdict in judged],
        "cost above the linear optimum": [
            verdict.cost_above_optimum_percent / 100.0 for verdict in judged
        ],
    }
    shown = {label: values for label, values in curves.items() if not np.all(np.isnan(values))}
    # Marks alone: between two critics there is none.
    for (label, values), mark in zip(shown.items(), "os^x", strict=False):
        axes.semilogy(positions, np.maximum(values, _ROUNDED), mark, label=label)
    axes.set_ylabel("relative error")
    axes.grid(alpha=0.3)
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), ncols=3, frameon=False)
    names = [Path(name).name for name in verdicts]
    axes.set_xticks(positions, names, rotation=30, ha="right", fontsize=7)
    return figure
