"""The report of a verdict: its first line, grades, checks and entries."""

import math
from dataclasses import replace

import numpy as np
import pytest
from game_samples import in_steps
from planted_critics import gain
from scipy.linalg import solve_discrete_lyapunov

from controller.game.linear_game import weights_line
from hfa import Game, from_gain, solve, verify
from hfa.extend import Check
from hfa_model.parameters import INPUTS, LINEAR_STATES, LINEAR_UNITS
from verification.box import ordinary_box, usual_box
from verification.reports import checks_part, verdicts_report
from verification.verdict import CounterExample, Proof

pytestmark = pytest.mark.usefixtures("folder")


def test_a_report_lists_the_entries_farthest_from_the_exact_ones(game):
    """The report on a wrong K lists the three entries farthest from the exact ones, of which -o FILE
    writes all; that on the exact K lists none.
    """
    exact = gain(game)
    assert "-o FILE writes all" not in str(verify(game, from_gain(game, exact)).report())
    learned = 1.001 * exact
    learned[2, 3] += 0.002 * np.abs(exact).max()
    off = np.abs(learned - exact)
    rows = verify(game, from_gain(game, learned)).report().parts[-1][0].rows
    places = [np.unravel_index(place, off.shape) for place in np.argsort(off, axis=None)[:-4:-1]]
    states, inputs = game.names[:2]
    found = {name: [float(each) for each in numbers] for name, *numbers in rows}
    assert found == {
        f"K({inputs[i]}, {states[j]})": pytest.approx(
            [learned[i, j], exact[i, j], learned[i, j] - exact[i, j]], rel=1e-2
        )
        for i, j in places
    }


@pytest.mark.parametrize(
    ("kind", "off", "above", "grade", "holds"),
    [
        ("", 0.0, 0.0, "exact", True),
        ("", 0.0, 0.9, "exact", False),
        ("", 0.0, 1.1, "fail", False),
        ("error", 0.5, 0.4, "near", True),
        ("error", 0.5, 1.0, "near", False),
        ("error", 0.5, 1.1, "fail", False),
        ("rest", 0.5, 0.0, "near", True),
        ("rest", 1.0, 0.0, "near", False),
        ("rest", 1.1, 0.0, "fail", False),
        ("stability", 0.5, 0.0, "fail", False),
        *((kind, 0.5, 0.0, "fail", True) for kind in ("game loop", "gain", "cost")),
    ],
)
def test_each_kind_of_check_has_its_grade(kind, off, above, grade, holds):
    """Besides passed checks of all kinds, one of a kind fails with the value `off`; the cost is `above`
    percent above the optimum.

    The grade is "near" if only errors fail, or the equilibrium (kind "rest"), and cost and V* at the
    equilibrium are at most 1 %. With a limit of 0.5 %, the critic passes (`holds`) if both are within
    it and the loop is stable.
    """
    kinds = ("error", "rest", "stability", "stability", "game loop", "gain", "cost")
    checks = [Check(f"{each} {i}", 0.0, 0.0, True, "", kind=each) for i, each in enumerate(kinds)]
    if kind:
        checks.insert(2, Check("failed", off, 0.0, False, "it failed", kind=kind))
    game = Game([[-1.0]], [[1.0]], E=[[1.0]], Q=[[1.0]], R=[[1.0]], delta=5.0)
    verdict = replace(
        verify(game, solve(game)),
        checks=tuple(checks),
        cost_above_optimum_percent=above,
    )
    assert verdict.grade == grade
    assert verdict.ok is (not kind and above <= 1.0)
    assert verdict.stabilizing is (kind != "stability")
    assert verdict.holds(0.5) is holds
    assert verdict.holds() is verdict.ok
    assert verdict.headline.startswith({"exact": "PASS", "near": "NEAR", "fail": "FAIL"}[grade])
    assert verdict.report(limit_cost=0.5).title.startswith("PASS" if holds else "FAIL")
    assert verdict.largest_error == (off if kind == "error" else 0.0)
    assert verdict.file_entries(0.5)["graded"]["ok"] is holds
    assert ("not stabilizing" in str(verdict)) is (kind == "stability")


TWO = Game(
    [[0.0, 1.0], [2.0, -0.3]], [[0.0], [1.0]], E=[[0.0], [1.0]], Q=[4.0, 1.0], R=[1.0], delta=9.0
)


def test_the_report_of_a_verdict_says_what_was_judged():
    """The heading names the game, the critic's file and the weights, or what is given about them; a wrong
    critic without a known mistake has advice; checks are counted, those beyond the first are named.
    """
    exact = solve(TWO)
    verdict = verify(TWO, exact)
    (gain,) = (check for check in verdict.checks if check.name == "l2_gain")
    assert f"L2 gain {gain.value:.4g} (delta 9)" in verdict.report().title
    lines = verdict.report().parts[0]
    assert "against the exact game solution" in lines[0]
    assert lines[1:] == (weights_line(TWO),)
    heading = verdict.report(about=["of the file"], source="K.npz").parts[0]
    assert heading[0].startswith("Critic of K.npz on ")
    assert heading[1:] == ("of the file",)
    assert verdict.report().parts[1] == (f"{len(verdict.checks)} checks passed",)
    rows = verdict.report().records.rows
    assert {(matrix, row, column) for matrix, row, column, *_ in rows} >= {
        ("K", "u1", "x2"),
        ("P", "x1", "x2"),
    }
    wrong = verify(TWO, from_gain(TWO, exact.K * [[1.03, 0.98]]))
    assert any(
        line.startswith("Compare signs, units and order") for line in wrong.report().parts[0]
    )
    assert not any(line.startswith("Reason") for line in wrong.report().parts[0])
    mistaken = verify(TWO, from_gain(TWO, -exact.K))
    assert f"Reason: {mistaken.reason}" in mistaken.report().parts[0]
    assert not any(line.startswith("Compare") for line in mistaken.report().parts[0])
    assert "by the paper's" not in mistaken.report().title
    limited = verdict.report(limit_cost=0.5).title
    assert "decided by the cost limit 0.5 %" in limited
    sampled = TWO.sampled(0.1)
    for game, words in (
        (sampled, ("sampled game", "discrete time, steps of 0.1 s")),
        (replace(sampled, dt=True), ("discrete game", "discrete time")),
        (TWO.sampled(0.1, 0.9), ("sampled game", "time, discount 0.9 a step, steps of 0.1 s")),
    ):
        report = verify(game, solve(game)).report()
        assert words[0] in report.title
        assert report.parts[0][0].endswith(words[1])


@pytest.mark.parametrize(
    ("low", "high", "is_bounded", "words"),
    [
        (0.0, 1e-17, True, "optimal cost"),
        (0.0123, 0.0123, True, "1.2 % above the optimum"),
        (0.0123, 0.0456, True, "1.2 % to 4.6 % above the optimum"),
        (0.0123, math.inf, True, "cost not decided, at least 1.2 % above the optimum"),
        (0.0, math.inf, False, "cost not decided"),
        (math.inf, math.inf, False, "cost without bound"),
    ],
)
def test_the_cost_of_a_linear_policy_in_words(low, high, is_bounded, words):
    """Of its bounds, the first line has one number where they agree; a line is at most 80 columns wide
    unless its first finding is wider.
    """
    verdict = verify(TWO, solve(TWO))
    matrix = verdict.suboptimality.matrix if is_bounded else None
    enclosed = replace(verdict.suboptimality, low=low, high=high, matrix=matrix)
    changed = replace(verdict, suboptimality=enclosed)
    findings = [line.rpartition(": ")[2] for line in changed.report().title.splitlines()]
    assert findings[0].partition(", exact within")[0] == words
    lines = changed.report().title.splitlines()
    assert all(len(line) <= 80 or ", exact" not in line for line in lines)
    assert "limit_cost_percent" not in changed.file_entries()["graded"]


@pytest.mark.parametrize(
    ("proof", "flights", "above", "words", "scope"),
    [
        (Proof(excess=0.005), 0, 0.5, "proved, at most 0.5 % above the optimum", ""),
        (Proof(excess=0.05), 0, 5.0, "proved stable, at most 5 % above the optimum", ""),
        (
            Proof(excess=0.05),
            3,
            0.4,
            "at least 0.4 % above the optimum",
            ", in 3 flights, not proved",
        ),
        (Proof(why="too wide"), 1, 0.0, "no flight above the optimum", ", in 1 flight, not proved"),
        (Proof(why="too wide"), 0, math.nan, "cost not decided", ""),
        (Proof(why="too wide"), 2, 4.0, "at least 4 % above the optimum from (x1 0.5, x2 -1)", ""),
        (Proof(), 2, math.inf, "cost without bound from (x1 0.5, x2 -1): diverges", ""),
    ],
)
def test_the_cost_of_a_network_in_words(proof, flights, above, words, scope):
    """What is proved within 1 %, or else what flights show, with the start of a counter-example."""
    verdict = verify(TWO, solve(TWO))
    worst = CounterExample(np.array([0.5, -1.0]), "diverges") if flights else None
    of_network = replace(
        verdict,
        proof=proof,
        flights=flights,
        worst_flight=worst,
        cost_above_optimum_percent=above,
        suboptimality=None,
    )
    title = of_network.report().title
    assert f"balanced box{scope}: " in title
    assert f": {words}" in title
    if flights and proof.is_found:
        assert "proved: stable, at most 5 % above the optimum" in title
    if proof.why:
        assert "not proved: too wide" in title
    assert f"K exact within {verdict.limit:g}" in title
    searched = Check("searched_policy_error", 1.0, 0.1, False, "the policy is off", kind="error")
    failing = replace(of_network, checks=(*verdict.checks, searched))
    assert "K exact within" in failing.report().title
    assert "the policy is off" in failing.report().title


def test_failed_checks_are_listed_and_the_others_counted():
    """Each failed check has a line, errors last; entries are left out beside the whole matrix."""
    names = ["P_entry_error", "P_rel_error", "stability 1", *[f"check {i}" for i in range(20)]]
    checks = [
        Check(name, 2.0, 1.0, False, f"of {name}", kind="error" if "error" in name else "stability")
        for name in names
    ]
    for count in range(1, len(checks) + 1):
        lines = checks_part([*checks[:count], Check("right", 0.0, 1.0, True, "")])
        shown = {"P_entry_error"} if count == 1 else {*names[1:count]}
        text = "\n".join(lines)
        assert lines[-1] == "1 check passed"
        assert all(name in text for name in shown)
        assert ("P_entry_error" in text) == (count == 1)
        assert ("FAIL too" in text) == (len(lines) - 2 > 0 and lines[-2].startswith("FAIL too"))
        first = [line for line in lines if line.startswith("FAIL ") and "too" not in line]
        assert f"{first[0]}".endswith("(must be <= 1)")
        if count > 2:
            assert "stability 1" in first[0]
        told = len(first) + sum(line.count(",") + 1 for line in lines if "FAIL too" in line)
        assert told == len(shown)


def test_a_table_of_critics_has_their_costs_and_reasons():
    """The errors, the cost in percent, 0 for rounding, the L2 gain, and the number that passes."""
    exact = solve(TWO)
    off = verify(TWO, from_gain(TWO, 1.2 * exact.K))
    report = verdicts_report({"right": verify(TWO, exact), "off": off}, 50.0)
    right, wrong = report.records.rows
    assert (right[0], *right[5:7]) == ("right", "yes", "0")
    assert float(wrong[3]) == pytest.approx(off.K_rel_error, rel=0.05)
    assert float(wrong[6]) == pytest.approx(off.cost_above_optimum_percent, rel=0.01)
    assert float(wrong[7]) == pytest.approx(off.value_of("l2_gain"), rel=1e-3)
    assert [str(row[1]) for row in report.records.rows] == ["PASS", "PASS"]
    assert "Decided by the cost limit 50 percent" in report.parts
    assert report.title.startswith("PASS: 2 of 2 critics pass")
    failing = verdicts_report({"off": off, "right": verify(TWO, exact)})
    assert failing.title.startswith("FAIL: 1 of 2 critics pass")
    assert failing.parts[-1] == ((f"off: {off.reason}",) if off.reason else ())


def test_the_box_of_a_game():
    """The typical one of the paper's aircraft in ft or m, that of limits, or the balanced one, which
    changes with the units of the states.
    """
    typical = np.array([7.0, 0.1, 0.1, 0.1, 0.1, 0.1])
    metres = ["m/s", *LINEAR_UNITS[1:]]
    for units, widths in (
        ((), typical),
        (LINEAR_UNITS, typical),
        (tuple(metres), typical * [0.3048, 1, 1, 1, 1, 1]),
        (("kt", *LINEAR_UNITS[1:]), None),
    ):
        box = ordinary_box(LINEAR_STATES, INPUTS[:2], units)
        assert box is None if widths is None else box.half_widths == pytest.approx(widths)
    assert ordinary_box(LINEAR_STATES, ("rudder",), ()) is None
    assert usual_box(replace(TWO, half_widths=np.array([2.0, 3.0]))).name == "box of limits"
    balanced = usual_box(TWO)
    assert balanced.name == "balanced box"
    units = np.array([8.0, 1.0])
    other = replace(
        TWO,
        A=TWO.A * units[:, None] / units,
        B=TWO.B * units[:, None],
        E=TWO.E * units[:, None],
        Q=TWO.Q / np.outer(units, units),
    )
    ratio = usual_box(other).half_widths / balanced.half_widths
    assert ratio[0] / ratio[1] == pytest.approx(8.0)


def discrete_game_value(A, E, Q, delta):
    """Return P of the maximum over d of Σ (x'Q x - delta² d'd) on x⁺ = A x + E d, by iteration."""
    P = solve_discrete_lyapunov(A.T, Q)
    for _ in range(50):
        gained = E.T @ P @ A
        slack = delta**2 * np.eye(E.shape[1]) - E.T @ P @ E
        P = Q + A.T @ P @ A + gained.T @ np.linalg.solve(slack, gained)
    return P


def test_loops_and_costs_of_a_discrete_verdict_are_those_of_numpy():
    """The spectral radii of A - B K and √α (A - B K), and the cost above the optimum, are those of
    NumPy, for 0.9 times the exact gain of a game with cross weights N.
    """
    rng = np.random.default_rng(6)
    A, B, E = (rng.standard_normal((3, size)) for size in (3, 2, 1))
    N = 0.1 * rng.standard_normal((3, 2))
    game = in_steps(Game(0.4 * A, B, E=E, Q=np.eye(3), R=np.diag([1.0, 2.0]), delta=1e3, N=N), 0.8)
    exact = solve(game)
    K = 0.9 * exact.K
    verdict = verify(game, from_gain(game, K))
    checks = {check.name: check.value for check in verdict.checks}
    cost_of_gain = game.Q - N @ K - (N @ K).T + K.T @ game.R @ K
    root = math.sqrt(0.8)
    loop = root * (game.A - B @ K)
    value = discrete_game_value(loop, root * E, cost_of_gain, game.delta)
    box = np.outer(verdict.box.half_widths, verdict.box.half_widths)
    above, optimum = (np.linalg.eigvalsh(P * box).max() for P in (value - exact.P, exact.P))
    assert verdict.cost_above_optimum_percent == pytest.approx(100.0 * above / optimum, rel=1e-8)
    of_each = np.linalg.eigvals(np.linalg.solve(exact.P, value - exact.P)).real.max()
    assert verdict.suboptimality.of_each == pytest.approx(of_each, rel=1e-6)
    radius = np.abs(np.linalg.eigvals(game.A - B @ K)).max()
    assert checks["control_loop_radius"] == pytest.approx(radius)
    assert checks["discounted_loop_radius"] == pytest.approx(root * radius)
