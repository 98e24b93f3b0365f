"""The report of a verdict: its first line, grades, checks and entries."""

from __future__ import annotations

import math
from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from cli import answer, hfa
from extension import Extension
from game_files import stored
from planted_critics import gain, other_root, value
from scipy.linalg import solve_discrete_lyapunov
from tolerances import SAME_FORMULA

from controller.critic.critic import Critic
from controller.hfa_game import ORDINARY_DEVIATIONS
from controller.riccati.margins import disk_margin
from hfa import (
    BadInputError,
    Game,
    from_gain,
    from_value,
    linearize,
    solve,
    trim,
    verify,
)
from hfa.paper import level_flight
from hfa_model import choice
from hfa_support.reporting.checks import at_most
from tests.support.steps_of import in_steps
from verification import Scope
from verification.axis import DECAY, SLOWEST
from verification.box import ordinary_box
from verification.figures import verdict_figure, verdicts_figure
from verification.judged_game import JudgedGame
from verification.scope import nonlinear_plant
from verification.verdict import verdicts_report

network_files = Extension("network_files")
searches = Extension("verification.network.search")
networks = Extension("controller.critic.network.critic")

pytestmark = pytest.mark.usefixtures("folder")
BOX = np.array(ORDINARY_DEVIATIONS)


def bent_actor(game: Game) -> Critic:
    """Return the policy u = -10 K tanh(z / 10), which is exact only to first order at z = 0."""
    layers = {"0.weight": 0.1 * np.eye(6), "2.weight": -10.0 * gain(game)}
    return networks.from_network(
        game, network_files.torch_file("bent.pt", layers), activation="tanh"
    )


CRITICS: dict[str, Any] = {
    "exact": lambda game: from_value(game, value(game)),
    "other root": lambda game: from_value(game, other_root(game)),
    "huge": lambda game: from_value(game, 1e40 * value(game)),
    "overflowing": lambda game: from_gain(game, np.full((5, 6), 1e300)),
    "unstable": lambda game: from_gain(game, -gain(game)),
    "near": lambda game: from_gain(game, (1.0 + 1.23456e-5) * gain(game)),
    "bent": bent_actor,
}


@pytest.mark.parametrize("name", CRITICS)
def test_the_first_line_has_at_most_80_columns(game: Game, name: str) -> None:
    """The first line states grade and stability of each planted critic in at most 80 columns."""
    scope = Scope(ordinary_box(), flights=3)
    verdict = verify(game, CRITICS[name](game), scope=scope)
    unstable = name in ("other root", "huge", "overflowing", "unstable")
    for limit_cost in (None, 1e-3):
        line, *further = verdict.report(limit_cost=limit_cost).title.splitlines()
        assert len(line) <= 80
        assert further
        grade = "PASS" if verdict.holds(limit_cost) else "FAIL"
        if limit_cost is None and name in ("near", "bent"):
            grade = "NEAR"
        assert line.startswith(grade)
        assert ("not stabilizing" in line) == unstable
    failed = [check for check in verdict.checks if not check.ok]
    if not failed:
        return
    lines = verdict.report().parts[1]
    kinds = {check.name: check.kind for check in failed}
    shown = [text.split()[1].rstrip(":") for text in lines[:6] if text.startswith("FAIL ")]
    are_errors = [kinds[name] == "error" for name in shown]
    assert are_errors == sorted(are_errors)
    decisive = {"P_rel_error", "K_rel_error"} & set(kinds)
    assert not decisive or next(name for name in shown if kinds[name] == "error") in decisive
    assert int(lines[-1].split()[0]) == len(verdict.checks) - len(failed)


def test_the_entries_of_a_report_are_the_farthest(game: Game) -> None:
    """Of P above the diagonal and of K, relative to the largest; none of an exact critic."""
    exact = verify(game, from_value(game, value(game))).report().text()
    assert f"{len(verify(game, from_value(game, value(game))).checks)} checks passed" in exact
    assert "-o FILE writes all" not in exact
    noise = np.random.default_rng(4).uniform(-0.3, 0.3, (6, 6))
    noise[0, 1] += 0.5 * np.abs(value(game)).max() / np.abs(value(game)[0, 1])
    factors = np.array([1.002, 1.0, 1.0, 1.0, 1.0])[:, None]
    near = verify(game, from_gain(game, factors * gain(game)))
    wrong = from_value(game, value(game) * (1.0 + noise + noise.T))
    off_gain = 1.001 * gain(game)
    off_gain[2, 3] += 0.45 * np.abs(gain(game)).max()
    verdict = replace(near, critic=replace(wrong, K=off_gain))
    P, K, states, inputs = verdict.critic.P, verdict.critic.K, *game.names[:2]
    assert P is not None
    off = {
        f"P({states[i]}, {states[j]})": (P, value(game), i, j)
        for i in range(6)
        for j in range(i, 6)
    }
    off |= {
        f"K({inputs[i]}, {states[j]})": (K, gain(game), i, j) for i in range(5) for j in range(6)
    }
    errors = {
        name: abs(learned[i, j] - right[i, j]) / np.abs(right).max()
        for name, (learned, right, i, j) in off.items()
    }
    farthest = sorted(errors, key=lambda name: -errors[name])[:3]
    table = verdict.report().parts[-1][0]
    assert {row[0] for row in table.rows} == set(farthest)
    for name, *numbers in table.rows:
        learned, right, i, j = off[name]
        both = learned[i, j], right[i, j]
        assert [float(each) for each in numbers] == pytest.approx(
            [*both, both[0] - both[1]], rel=1e-2
        )
    verdict = verify(game, from_gain(game, -gain(game)))
    report = verdicts_report({"a": verdict, "b": near}, "a plant")
    for row, each in zip(report.parts[0].rows, (verdict, near), strict=True):
        shown = [*row[2:5], *row[6:]]
        figures = each.P_rel_error, each.K_rel_error, each.largest_error
        expected = [*figures, each.cost_lost, each.value_of("l2_gain")]
        assert [float(text or "nan") for text in shown] == pytest.approx(
            expected, rel=1e-2, nan_ok=True
        )
        assert row[5] == ("yes" if each.stabilizing else "no")
    curves = {
        line.get_label(): line.get_ydata()
        for line in verdicts_figure({"a": verdict, "b": near}, "a plant").axes[0].lines
    }
    assert curves["cost above the linear optimum"] == pytest.approx(
        [verdict.cost_lost / 100.0, near.cost_lost / 100.0]
    )
    assert curves["largest error"] == pytest.approx([verdict.largest_error, near.largest_error])
    maps = [axes for axes in verdict_figure(near).axes if axes.images]
    K = near.critic.K
    for axes, matrix in zip(
        maps, (K, gain(game), (factors - 1.0) * np.sign(gain(game))), strict=True
    ):
        (image,) = axes.images
        assert np.asarray(image.get_array()) == pytest.approx(matrix, rel=1e-9, abs=1e-15)
        assert image.norm.vmin == -image.norm.vmax
        is_difference = matrix is not K and matrix is not gain(game)
        assert is_difference or image.norm.vmax == np.abs(gain(game)).max()
        ticks = image.colorbar.get_ticks()
        assert 0.1 * image.norm.vmax < ticks.max() <= image.norm.vmax
        assert (axes.get_xlabel() == "") is is_difference
        assert [label.get_text() for label in axes.get_yticklabels()] == list(inputs)


# Networks: searched states, and simulations.


def test_no_network_error_exceeds_the_reported_one(game: Game) -> None:
    """The errors of a network's V at random states, and at the worst states found, are at most the
    reported one.
    """
    z = np.random.default_rng(0).uniform(-0.3, 0.3, (20, 6)) * BOX
    layers = {
        "0.weight": np.vstack([np.diag(1.0 / BOX), -np.diag(1.0 / BOX)]),
        "2.weight": np.arange(1.0, 13.0)[None],
    }
    critic = networks.from_network(
        game, network_files.torch_file("v.pt", layers), activation="softplus"
    )
    assert critic.value is not None
    exact = solve(game)
    _, found = searches.search(searches.Comparison(critic, exact, np.sqrt(np.diag(game.R)), BOX))
    errors = {item.name: item.error for item in found}
    size = BOX @ np.abs(exact.P) @ BOX
    for state in (*(item.at for item in found), *z):
        error = float(critic.value(state)) - critic.constant - state @ exact.P @ state
        assert abs(error) / size <= errors["value"] * (1.0 + 1e-12)


def test_networks_saturate_at_the_control_limits() -> None:
    """In flights of a network on the nonlinear plant, the inputs are saturated at the control
    limits.
    """
    model = choice.aircraft()
    point = trim(model, level_flight(np.radians(15.0)))
    plant = nonlinear_plant(linearize(model, point))
    z = np.zeros(6)
    u = np.full(5, 1000.0)
    assert np.all(plant.highest < u)
    held = np.array(plant.rates(z, plant.highest))
    assert np.array(plant.closed(z, u)) == pytest.approx(held, rel=SAME_FORMULA)
    assert np.array(plant.closed(z, 0.0 * u)) == pytest.approx(0.0, abs=1e-8)


def test_a_verdict_has_three_grades(game: Game) -> None:
    """The grade of a verdict is "exact", "near" (at most 1 % more cost) or "fail"."""
    grades = {
        "exact": from_gain(game, gain(game)),
        "near": from_gain(game, 1.002 * gain(game)),
        "fail": from_gain(game, -gain(game)),
    }
    for grade, critic in grades.items():
        verdict = verify(game, critic)
        assert verdict.grade == verdict.to_dict()["grade"] == grade
        assert verdict.ok == (grade == "exact")
    near = verify(game, grades["near"])
    assert near.cost_lost < 1.0
    assert near.headline().startswith("NEAR on the linear game, typical box: ")
    assert near.report(limit_cost=1.0).title.startswith("PASS on the linear game, typical box: ")
    far = verify(game, from_gain(game, 1.5 * gain(game)))
    assert (far.grade, far.stabilizing) == ("fail", True)
    assert far.cost_lost > 1.0


def test_the_command_prints_the_source_of_weights(game: Game) -> None:
    """The report states the source of Q, R and delta: the file, an option, or the default."""
    plant = stored("plant.json", A=[[1.0]], B=[[1.0]], Q=[[2.0]])
    critic = stored("K.npz", K=np.array([[1.0 + np.sqrt(3.0)]]))
    result = hfa("verify", "--model", plant, "--R", "1", "--weights", critic)
    assert "Q diag(2) (file), R diag(1) (given), delta inf (default)" in result.out
    data = answer("verify", "--model", plant, "--R", "1", "--weights", critic)
    assert data["weights_from"] == {"Q": "file", "R": "given", "delta": "default"}
    assert (data["Q"], data["R"], data["grade"]) == ([[2.0]], [[1.0]], "exact")


@pytest.mark.parametrize(
    ("kind", "off", "cost_lost", "grade", "holds"),
    [
        ("", 0.0, 0.0, "exact", True),
        ("error", 0.5, 0.4, "near", True),
        ("error", 0.5, 1.0, "near", False),
        ("error", 0.5, 1.1, "fail", False),
        ("rest", 1e-6, 0.0, "near", True),
        ("rest", 2e-6, 0.0, "fail", False),
        *((kind, 0.5, 0.0, "fail", True) for kind in ("stability", "game loop", "gain", "cost")),
        ("data", 0.5, 0.0, "fail", True),
    ],
)
def test_each_kind_of_check_has_its_grade(
    kind: str, off: float, cost_lost: float, grade: str, holds: bool
) -> None:
    """Only errors and a rest at the trim may fail in "near"; a cost limit asks cost and rest."""
    kinds = ("error", "rest", "stability", "stability", "game loop", "gain", "cost", "data")
    checks = [at_most(f"{each} {i}", 0.0, 0.0, "", kind=each) for i, each in enumerate(kinds)]
    if kind:
        checks.insert(2, at_most("failed", off, 0.0, "it failed", kind=kind))
    game = Game([[-1.0]], [[1.0]], [[1.0]], [[1.0]], [[1.0]], 5.0)
    verdict = replace(verify(game, solve(game)), checks=tuple(checks), cost_lost=cost_lost)
    assert verdict.grade == grade
    assert verdict.ok is not bool(kind)
    assert verdict.stabilizing is (kind != "stability")
    assert verdict.holds(0.5) is holds
    assert verdict.holds() is verdict.ok
    assert verdict.grade_text() == {"exact": "PASS", "near": "NEAR", "fail": "FAIL"}[grade]
    assert verdict.grade_text(0.5) == ("PASS" if holds else "FAIL")
    assert verdict.largest_error == (off if kind == "error" else 0.0)
    assert verdict.data(0.5)["graded"]["ok"] is holds
    text = str(replace(verdict, cost_lost=cost_lost or 0.3))
    assert f"{cost_lost or 0.3:.2g} % above the optimum" in text
    assert ("not stabilizing" in text) is (kind == "stability")
    assert "stabilizing" in text
    assert "L2 gain 0 (delta 0)" in text or kind == "gain"
    assert "cost without bound" in str(replace(verdict, cost_lost=math.inf))
    title = verdicts_report({"a": verdict, "b": verdict}, "a plant", 0.5).title
    assert title.startswith(f"{'PASS' if holds else 'FAIL'}: {2 * holds} of 2 critics pass")


def test_loops_and_costs_of_a_verdict_are_those_of_numpy() -> None:
    """Radii, abscissas, residuals and costs of both kinds of games, of a P that is not symmetric."""
    rng = np.random.default_rng(6)
    A, B, E = (rng.standard_normal((3, size)) for size in (3, 2, 1))
    N = 0.1 * rng.standard_normal((3, 2))
    game = Game(A, B, E, np.eye(3), np.diag([1.0, 2.0]), 1e3, N)
    step = Game(0.4 * A, B, E, np.eye(3), np.diag([1.0, 2.0]), 1e3, N)
    z, u = rng.standard_normal(3), rng.standard_normal(2)
    paid = z @ z + 2.0 * z @ N @ u + u @ game.R @ u
    P = solve(game).P
    skewed = P + 0.1 * (np.triu(np.ones((3, 3)), 1) - np.tril(np.ones((3, 3)), -1))
    in_time = JudgedGame(game)
    loop = game.A - game.B @ game.gain(P) + game.E @ game.E.T @ P / game.delta**2
    abscissa = np.linalg.eigvals(loop).real.max()
    assert in_time.game_loop(P).value == pytest.approx(abscissa, rel=1e-9)
    assert in_time.cost(z, u) == pytest.approx(paid)
    found = in_time.linear_loop(from_gain(game, 0.8 * in_time.exact.K), False)
    (table,) = found.section.part
    cost = found.section.data.graded
    pairs = [(cost.worst, 0.0), (cost.mean, 0.0), (cost.gain, cost.exact_gain)]
    pairs.append((cost.distance, cost.exact_distance))
    margins = [disk_margin(game, each) for each in (0.8 * in_time.exact.K, in_time.exact.K)]
    pairs += zip(*(margin[:3] for margin in margins), strict=True)
    shown = np.array([row[1:] for row in table.rows], dtype=float)
    assert shown == pytest.approx(np.array(pairs), rel=5e-3)
    assert np.ptp(shown, axis=1).all()
    assert found.cost_lost == cost.worst
    assert in_time.is_stable(in_time.exact.K)
    assert not in_time.is_stable(-in_time.exact.K)
    by_exact = -np.linalg.eigvals(A - B @ in_time.exact.K).real.max()
    for rate in (9.0 * by_exact, 0.5 * by_exact, 1e-9 * by_exact):
        slowest = max(min(rate, by_exact), by_exact / SLOWEST)
        assert in_time._duration(-rate * np.eye(3)) == pytest.approx(DECAY / slowest, rel=1e-9)
    problem = in_steps(step, 0.8)
    sampled = JudgedGame(problem)
    K, L = problem.policies(P)
    radius = np.abs(np.linalg.eigvals(step.A - step.B @ K + step.E @ L)).max()
    for given in (P, skewed):
        found = sampled.game_loop(given)
        assert found.value == pytest.approx(math.sqrt(0.8) * radius, rel=1e-9)
        assert sampled.residuals(given[None]) == pytest.approx(sampled.residuals(P[None]))
    assert sampled.cost(z, u) == pytest.approx(paid)
    assert sampled.residuals(sampled.exact.P[None])[0] < 1e-12
    assert sampled.residuals(1.1 * sampled.exact.P[None])[0] > 1e-3
    exact = sampled.exact
    critic = from_gain(problem, 0.9 * exact.K)
    found = sampled.linear_loop(critic, True)
    checks = {check.name: check.value for check in found.checks}
    L = exact.disturbance_gain
    crossed = N @ critic.K
    spent = step.Q - crossed - crossed.T + critic.K.T @ step.R @ critic.K - step.delta**2 * L.T @ L
    whole = solve_discrete_lyapunov(
        math.sqrt(0.8) * (step.A - step.B @ critic.K + step.E @ L).T, spent
    )
    excess = np.linalg.eigvals(np.linalg.solve(exact.P, whole - exact.P)).real
    assert found.cost_lost == pytest.approx(100.0 * excess.max(), rel=1e-8)
    assert found.section.data.graded.worst == found.cost_lost
    assert sampled.excess(critic.K) == pytest.approx(whole - exact.P, rel=1e-6)
    H = exact.H + rng.uniform(0.1, 0.2, exact.H.shape)
    learned = replace(critic, L=1.5 * L, H=H)
    sizes = np.sqrt(np.abs(np.diag(exact.H)))
    more = [check.value for check in sampled.more_errors(learned, np.ones(3), 1e-6)]
    off = (np.abs(H - exact.H) / sizes / sizes[:, None]).max()
    assert more == pytest.approx([0.5, off])
    radius = np.abs(np.linalg.eigvals(step.A - step.B @ critic.K)).max()
    assert checks["control_loop_radius"] == pytest.approx(radius)
    assert checks["discounted_loop_radius"] == pytest.approx(math.sqrt(0.8) * radius)
    assert critic.u(z) == pytest.approx(-critic.K @ z)
    assert critic.u(np.stack([z, 2.0 * z])) == pytest.approx(
        np.stack([-critic.K @ z] * 2) * [[1], [2]]
    )
    for wrong in (z[:2], np.ones((1, 2, 3)), 1.0):
        with pytest.raises(BadInputError, match=r"give \(3,\) or \(N, 3\)"):
            critic.u(wrong)
