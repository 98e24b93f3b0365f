"""The report of a verdict: its first line, grades, checks and entries."""

import math
from dataclasses import replace

import numpy as np
import pytest
from cli import answer
from game_files import stored
from game_samples import in_steps
from planted_critics import gain
from scipy.linalg import solve_discrete_lyapunov

from hfa import Game, from_gain, solve, verify
from hfa.extend import Check
from hfa_support.reporting.text import percent
from verification.reports import verdicts_report

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


def test_a_wrong_critic_among_several_fails():
    """`hfa verify` of a right and a wrong gain fails, though the right one alone passes.

    On x' = x + u with Q = 2, R = 1, the exact gain is 1 + √3.
    """
    plant = stored("plant.json", A=[[1.0]], B=[[1.0]], Q=[[2.0]], R=[[1.0]])
    K = 1.0 + np.sqrt(3.0)
    files = [stored(f"{factor}.npz", K=np.array([[factor * K]])) for factor in (1.0, -1.0)]
    words = ("verify", "--model", plant, "--weights")
    assert answer(*words, files[0])["ok"]
    assert not answer(*words, *files, code=1)["ok"]


def test_an_undecided_cost_is_not_printed_as_0():
    """The table of several critics has "?" where the cost above the optimum is not known."""
    game = Game([[1.0]], [[1.0]], Q=[[2.0]], R=[[1.0]])
    undecided = replace(verify(game, solve(game)), cost_above_optimum_percent=math.nan)
    assert str(verdicts_report({"undecided": undecided})).split()[-1] == "?"


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


def test_an_upper_bound_in_percent_is_rounded_up():
    """`percent` with up=True rounds up to two digits, or to a whole number above 99; without it, it
    rounds to the nearest.
    """
    shown = {31.23: "32 %", 634.2: "635 %", 7.53e-5: "7.6e-05 %", 99.96: "100 %"}
    assert {value: percent(value, up=True) for value in shown} == shown
    assert [percent(31.23), percent(-0.0), percent(2.5e7)] == ["31 %", "0 %", "2.5e+07 %"]
