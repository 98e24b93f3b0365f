"""The certified law, which finds the exact solution in predefined time or fails with the reason."""

from __future__ import annotations

import math
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from game_samples import failed_names, random_game
from known_models import game_at
from learning_samples import (
    PUBLISHED,
    QUADRATIC,
    abscissa,
    assert_exact,
    lq,
    published,
    random_start,
    start_at_the_edge,
)
from reference_riccati import reference_solution, relative_error
from scipy.integrate import solve_ivp

from controller import Stack, basis, random_pool, record, run
from controller.game.basis import BASES
from controller.learning import certified
from controller.learning.bellman_equations import PartialGame, StackEquations
from controller.learning.certified import (
    CertifiedSettings,
    Point,
    after,
    certified_law,
    decay_rate,
    discount_at,
)
from controller.learning.integral_rl import probing_flight
from hfa import BadInputError, Game, NoSolutionError, learn, solve, verify
from hfa_model import VARIANTS

# The solution.


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize(
    ("predefined_time", "tick", "start"),
    [
        (0.5, 0.1, 100.0),
        pytest.param(60.0, 0.1, 100.0, marks=pytest.mark.slow),
        pytest.param(10.0, 0.01, 100.0, marks=pytest.mark.slow),
        (1.0, 0.3, 100.0),
        pytest.param(10.0, 0.01, 0.0, marks=pytest.mark.slow),
        *(
            pytest.param(time, 0.001, 100.0, marks=pytest.mark.slow)
            for time in (0.5, 2.0, 10.0, 60.0)
        ),
    ],
)
def test_published_games_are_learned_by_predefined_times(
    name: str, predefined_time: float, tick: float, start: float
) -> None:
    """Both published games are learned to 1e-11 by the predefined time, for each tested tick."""
    game, exact = published(name)
    result = learn(game, predefined_time=predefined_time, tick=tick, initial_weights=start)
    assert_exact(result, exact, limit=1e-11)
    if tick != 0.001:  # with smaller ticks, rows are omitted
        assert result.time == pytest.approx(
            np.append(np.arange(0.0, predefined_time - 1e-9, tick), predefined_time)
        )
    assert result.time[-1] == predefined_time
    assert result.weights[0] == pytest.approx(np.full(21, start))


@pytest.mark.parametrize("starts", [8, pytest.param(1000, marks=pytest.mark.slow)])
def test_random_initial_weights_converge_to_the_solution(starts: int) -> None:
    """Learning from random initial weights, stabilizing or not, converges to the exact solution."""
    stabilizing = 0
    for index in range(starts):
        game, exact = published(PUBLISHED[index // 4 % 2])
        weights = random_start(index, game, exact.P)
        stabilizing += abscissa(game.A - game.S_control @ QUADRATIC.matrix(weights)) < 0.0
        samples = 21 + index % 80
        assert_exact(
            learn(game, seed=index, tick=0.2, samples=samples, initial_weights=tuple(weights)),
            exact,
        )
    assert 0.05 * starts < stabilizing < 0.95 * starts


@pytest.mark.slow
@pytest.mark.parametrize("name", [name for name in BASES if name not in ("quadratic", "quintic")])
def test_richer_bases_learn_a_quadratic_value(name: str) -> None:
    """With a richer basis, the learned weights of functions that are not quadratic are nearly 0.

    These weights are below 1e-9 of the largest weight.
    """
    game, exact = published(PUBLISHED[0])
    result = learn(game, basis=name, tick=0.1)
    assert_exact(result, exact)
    assert result.weights.shape[1] == basis(name, 6).size
    assert np.abs(result.weights[-1][21:]).max() < 1e-9 * np.abs(result.weights[-1]).max()
    assert np.all(result.weights[0] == pytest.approx(100.0))


@pytest.mark.slow
@pytest.mark.parametrize("games", [4, pytest.param(24, marks=pytest.mark.slow)])
@pytest.mark.parametrize("scaled", [pytest.param(False, marks=pytest.mark.slow), True])
def test_random_games_are_solved_or_refused_correctly(scaled: bool, games: int) -> None:
    """The law finds P of random games to 1e-7 if a solution exists, and refuses all other games."""
    rng = np.random.default_rng(5)
    solved = refused = 0
    for index in range(games):
        game = random_game(rng, scaled=scaled)
        exact = reference_solution(game)
        if exact.exists:
            result = learn(game, seed=index, tick=0.2, initial_weights=0.0)
            assert relative_error(result.P, exact.P) < 1e-7
            solved += result.settled
        else:
            with pytest.raises(NoSolutionError):
                learn(game, seed=index, tick=0.2, initial_weights=0.0)
            refused += 1
    assert min(solved, refused) >= max(1, games // 5)


@pytest.mark.slow
@pytest.mark.parametrize("dynamics", VARIANTS)
@pytest.mark.parametrize(
    "degrees", [5, *(pytest.param(i, marks=pytest.mark.slow) for i in range(21) if i != 5)]
)
def test_the_law_converges_at_every_dihedral_angle(dynamics: str, degrees: int) -> None:
    """The law finds the exact solution at each dihedral angle for both variants of the dynamics."""
    game = game_at(degrees, dynamics)
    assert_exact(learn(game), solve(game))


# The law.


@pytest.mark.parametrize("name", [PUBLISHED[0], pytest.param(PUBLISHED[1], marks=pytest.mark.slow)])
@pytest.mark.parametrize("start", [100.0, -3.0])
def test_residual_follows_the_scalar_law_at_every_tick(name: str, start: float) -> None:
    """From tick to tick, the residual decays as the closed-form solution of the scalar law."""
    game, _ = published(name)
    law = certified_law(game, CertifiedSettings(initial_weights=start, tick=0.05), seed=0)
    residual = run(law).history["law_residual_norm"]
    rate = decay_rate(law.stage_time, 0.8, 0.9)
    in_stage = range(int(0.9 * law.stage_time / 0.05) - 1)
    reached = [(residual[tick + 1], after(residual[tick], rate, 0.8, 0.05)) for tick in in_stage]
    moving = [(value, exact) for value, exact in reached if exact > 0.0]
    assert len(moving) > 20
    assert max(abs(value / exact - 1.0) for value, exact in moving) < 1e-7
    assert residual[int(0.9 * law.stage_time / 0.05)] < 1e-10 * residual[0]


def test_long_runs_record_some_ticks_and_the_last(monkeypatch: pytest.MonkeyPatch) -> None:
    """At most MOST_ROWS rows are recorded, at a constant distance, and the last tick always."""
    monkeypatch.setattr("controller.learning.ticks.MOST_ROWS", 5)
    learner = SimpleNamespace(start=list, advance=lambda tick, memory: [*memory, tick])
    learner.observe = lambda tick, memory: {"time": tick, "known": memory == list(range(tick))}
    recorded = ((4, [0, 1, 2, 3, 4]), (7, [0, 2, 4, 6, 7]), (9, [0, 3, 6, 9]))
    for learner.ticks, rows in recorded:
        history = run(learner).history
        assert history["time"].tolist() == rows
        assert history["known"].all()


def test_residuals_are_those_of_the_isaacs_equation() -> None:
    """e = ∇V'F + z'Qz - ¼ ∇V'S∇V at each sample, relative to the cost and to all its terms."""
    rng = np.random.default_rng(3)
    A, B, E = (rng.standard_normal((3, size)) for size in (3, 2, 1))
    game = Game(A, B, E, np.diag([1.0, 2.0, 3.0]), np.diag([0.5, 2.0]), 1.5)
    z = rng.standard_normal((40, 3))
    psi = basis("quadratic", 3)
    scales = np.array([1.0, 0.1, 20.0])
    equations = StackEquations.build(game, psi, Stack(z, z @ A.T), scales)
    weights = rng.standard_normal(psi.size)
    found = equations.reported_residuals(equations.scaled(weights))
    slopes = np.einsum("nmi,m->ni", psi.gradient(z), weights)
    changes = slopes * (z @ A.T)
    cost = np.einsum("ni,ij,nj->n", z, game.Q, z)
    won = 0.25 * np.einsum("ni,ij,nj->n", slopes, game.S, slopes)
    norm = np.linalg.norm(changes.sum(axis=1) + cost - won)
    size = np.linalg.norm(np.abs(changes).sum(axis=1) + cost + np.abs(won))
    assert found["residual_norm"] == pytest.approx(norm / np.linalg.norm(cost))
    assert found["settling_residual"] == pytest.approx(norm / size)
    problem = PartialGame(0.3, 0.6)
    at = equations.at(equations.scaled(weights), problem)
    S = game.S_control - 0.6 * game.S_disturbance / game.delta**2
    won = 0.25 * np.einsum("ni,ij,nj->n", slopes, S, slopes)
    change = np.einsum("ni,ni->n", slopes, z @ A.T - 0.3 * z) - 2.0 * won
    assert at.residuals == pytest.approx(change + cost + won)
    assert at.size == pytest.approx(np.abs(change) + cost + np.abs(won))


def test_the_discount_of_a_stage_falls_to_zero() -> None:
    """It hardly depends on a large discount at the begin, and little on a small one."""
    for progress in (0.1, 0.5, 0.9, 1.0):
        largest = (1.0 - progress) / (2.0 * progress)
        assert discount_at(progress, 1e9) == pytest.approx(largest, rel=1e-6)
        assert discount_at(progress, 1e-9) == pytest.approx(1e-9 * (1.0 - progress), rel=1e-6)


def test_riccati_residual_contracts_as_a_whole() -> None:
    """In stage 1 the Riccati residual remains a multiple of its initial value, R(P(t)) = c(t)
    R(P₀).

    The deviation from this, due to finite sub-steps, decreases with the tick.
    """
    game, exact = lq(PUBLISHED[1])

    def departure(tick: float) -> float:
        weights = tuple(QUADRATIC.weights(3.0 * exact.P))
        law = certified_law(
            game, CertifiedSettings(initial_weights=weights, tick=tick, predefined_time=4.0), seed=0
        )
        history = run(law).history
        middle = round(0.3 / tick)
        first, later = (
            game.residual(QUADRATIC.matrix(history["weights"][row])) for row in (0, middle)
        )
        ratio = float(np.sum(first * later) / np.sum(first * first))
        assert 0.01 < ratio < 0.5
        return float(np.linalg.norm(later - ratio * first) / np.linalg.norm(later))

    coarse = departure(0.05)
    fine = departure(0.0125)
    assert fine < 0.35 * coarse
    assert fine < 0.05


# Data that the law uses.


def test_learning_depends_on_the_recorded_data_only() -> None:
    """A game with another A and the same recorded data gives bit-identical learned weights.

    `verify` accepts the result only for the game with the true A.
    """
    game, _ = published(PUBLISHED[0])
    stack = random_pool(game, 200, seed=1)
    moved_game = replace(game, A=game.A - 0.5 * np.eye(6))
    right, wrong = (learn(g, tick=0.2, pool=stack) for g in (game, moved_game))
    assert np.array_equal(right.weights, wrong.weights)
    assert right.settled
    assert wrong.settled
    for judged, learned in ((game, right), (moved_game, wrong)):
        assert verify(judged, learned).ok is (judged is game)


@pytest.mark.parametrize("name", PUBLISHED)
@pytest.mark.parametrize("duration", [5.0, pytest.param(20.0, marks=pytest.mark.slow)])
def test_one_probing_flight_contains_enough_data(name: str, duration: float) -> None:
    """The states recorded in one probing flight are enough to learn the exact solution."""
    game, exact = published(name)
    for seed in range(2):
        states, _, _ = probing_flight(game, seed, np.linspace(0.0, duration, 500), (0.05, 0.05))
        assert_exact(learn(game, tick=0.2, pool=record(game, states)), exact)


def test_no_riccati_solver_is_called(monkeypatch: pytest.MonkeyPatch) -> None:
    """The law works without SciPy's Riccati solvers."""
    for name in ("solve_continuous_are", "solve_discrete_are"):
        monkeypatch.delattr(f"scipy.linalg.{name}")
    assert learn(published(PUBLISHED[0])[0], tick=0.2).settled


@pytest.mark.parametrize("noise", [1e-4, pytest.param(1e-2, marks=pytest.mark.slow)])
def test_a_gain_from_noisy_derivatives_is_refused(noise: float) -> None:
    """`verify` refuses P of a critic learned from noisy derivatives, whose gain stabilizes.

    The error of P is below five times the noise, and `drift_misfit` is the noise to 20 %.
    """
    for name in PUBLISHED[: 1 if noise < 1e-3 else 2]:
        game, exact = published(name)
        pool = random_pool(game, 500, seed=3)
        disturbed = np.random.default_rng(4).normal(size=pool.drifts.shape) * pool.drifts.std(
            axis=0
        )
        result = learn(game, tick=0.2, pool=Stack(pool.states, pool.drifts + noise * disturbed))
        verdict = verify(game, result)
        assert "P_rel_error" in failed_names(verdict.checks)
        assert relative_error(result.P, exact.P) < 5.0 * noise
        assert abscissa(game.A - game.B @ result.K) < 0.0
        assert result.diagnostics["drift_misfit"] == pytest.approx(noise, rel=0.2)


def test_the_first_line_states_the_misfit_of_a_noisy_record() -> None:
    """The first line states the misfit of noisy drifts. With exact drifts, it ends with "settled".

    The noise makes the learned gain wrong by more than 5 %.
    """
    game, exact = published(PUBLISHED[0])
    pool = random_pool(game, 500, seed=3)
    noise = np.random.default_rng(4).normal(size=pool.drifts.shape) * pool.drifts.std(axis=0)
    noisy = learn(game, tick=0.2, pool=Stack(pool.states, pool.drifts + 0.3 * noise))
    assert noisy.settled
    assert relative_error(noisy.K, exact.K) > 0.05
    first_line = noisy.report().text(width=None).splitlines()[0]
    stated = float(first_line.rsplit(" ", 2)[1])
    assert stated == pytest.approx(100.0 * noisy.diagnostics["drift_misfit"], rel=0.05)
    right = learn(game, tick=0.2, pool=pool)
    assert right.report().text(width=None).splitlines()[0].endswith(": settled")


RATE = decay_rate(time=5.0, eta=0.8, theta=0.9)
ETA = 0.8


@pytest.mark.parametrize("start", [1e-3, 0.5, 3.0, 40.0])
def test_a_step_of_the_scalar_law_is_exact(start: float) -> None:
    """A step `after` of the scalar law equals a numerical integration while y > 0.

    The law is y' = -k (y^(1-η) + y^(1+η)).
    """
    settle = math.atan(start**ETA) / (ETA * RATE)
    times = np.linspace(0.0, 0.9 * settle, 7)
    flow = solve_ivp(
        lambda _, y: -RATE * (y ** (1.0 - ETA) + y ** (1.0 + ETA)),
        (0.0, times[-1]),
        [start],
        t_eval=times,
        rtol=1e-11,
        atol=1e-15,
    )
    assert [after(start, RATE, ETA, t) for t in times] == pytest.approx(flow.y[0], rel=1e-7)


# The edge of stability.


def test_the_law_fails_without_its_safeguards(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without its safeguards, the law fails or gives a wrong P in at least one of two runs.

    The safeguards are directions by QR, the stability test of each step, and the initial discount.
    The initial weights are at the edge of stability.
    """

    def truncated(found: Any, normaliser: np.ndarray) -> np.ndarray:
        return np.asarray(
            np.linalg.pinv(found.regressors / normaliser[:, None]) @ (found.residuals / normaliser)
        )

    def unguarded(
        equations: StackEquations, here: Point, step: np.ndarray, fraction: float
    ) -> Point:
        return here._replace(weights=here.weights - fraction * step)

    # Faults of an earlier version, which no input reproduces.
    monkeypatch.setattr(certified, "RELATIVE_MARGIN", 0.0)
    monkeypatch.setattr(certified, "newton_step", truncated)
    monkeypatch.setattr(certified, "stabilizing_step", unguarded)
    lost = 0
    for seed in (4, 5):
        game, exact = lq(PUBLISHED[seed % 2])
        start = tuple(start_at_the_edge(game, exact.P, seed, margin=1e-11))
        try:
            result = learn(game, seed=seed, tick=0.2, initial_weights=start)
        except NoSolutionError:
            lost += 1
            continue
        lost += relative_error(result.P, exact.P) > 1e-9
    assert lost > 0


# No solution, and bad requests.


@pytest.mark.parametrize("name", [PUBLISHED[0], pytest.param(PUBLISHED[1], marks=pytest.mark.slow)])
def test_a_delta_too_small_is_refused(name: str) -> None:
    """A delta that is too small is refused, and the message names the smallest delta to 0.1 %."""
    game, _ = published(name)
    with pytest.raises(
        NoSolutionError, match=r"no solution for delta = 50, .*; choose a larger delta"
    ) as refusal:
        learn(game.with_delta(50.0), tick=0.1)
    least = float(str(refusal.value).split("to exist at delta = ")[1].split(";")[0])
    assert reference_solution(game.with_delta(1.001 * least)).exists
    assert not reference_solution(game.with_delta(0.999 * least)).exists
    assert learn(game.with_delta(1.001 * least), tick=0.1).settled
    with pytest.raises(NoSolutionError, match="the law finds no solution"):
        learn(game.with_delta(0.999 * least), tick=0.1)


def test_a_plant_that_no_input_stabilizes_is_refused() -> None:
    """A plant that no input stabilizes is refused.

    The message states the value below which the discount cannot be lowered.
    """
    game = Game(
        A=np.diag([0.3, -1.0]), B=[[0.0], [1.0]], E=np.eye(2), Q=np.eye(2), R=[[1.0]], delta=np.inf
    )
    with pytest.raises(NoSolutionError, match=r"cannot be lowered below 0\.3.*stabilizable"):
        learn(game, tick=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"predefined_time": 0.0}, "predefined_time is 0.0"),
        ({"tick": 11.0}, "tick is 11.0 s; give at most the predefined_time"),
        ({"eta": 1.0}, "eta is 1.0"),
        ({"samples": 20}, "20 samples cannot determine 21 weights"),
        ({"samples": 30.5}, "samples is 30.5"),
        ({"pool_samples": 40}, "the pool contains 40 samples, but 50 are requested"),
        (
            {"pool_samples": 10**11},
            "pool_samples is 100000000000; give a whole number from 1 to 100000",
        ),
        ({"pool": 40}, "pool is 40; give record"),
        ({"basis": "sextic"}, "unknown basis 'sextic'"),
        (
            {"initial_weights": (1.0, 2.0)},
            "initial_weights has 2 elements; give 21 for basis 'quadratic'",
        ),
        ({"initial_weights": np.nan}, r"initial_weights\[0\] is nan"),
        (
            {"gamma": 0.01},
            "law 'certified' has no setting 'gamma'; choose from predefined_time, tick",
        ),
        ({"law": "magic"}, "unknown law 'magic'; choose from certified"),
    ],
)
def test_bad_requests_name_the_setting(options: dict[str, Any], message: str) -> None:
    """A wrong setting of the law is refused, and the message names the setting."""
    with pytest.raises(BadInputError, match=message):
        learn(published(PUBLISHED[0])[0], **options)
