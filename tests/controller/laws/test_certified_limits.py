"""The certified law at its limits: starts at the edge of stability, games without a value, bad requests."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, assert_exact, build, lq, published, start_at_the_edge
from reference_riccati import reference_solution, relative_error

from controller import Game, learn
from controller.laws import certified
from controller.laws.bellman_equations import LQ, StackEquations, newton_step
from controller.laws.certified import (
    CertifiedLaw,
    CertifiedSettings,
    Point,
    certified_law,
)
from hfa_support import BadInputError, NoSolutionError

# The edge of stability.


def exact_direction(game: Game, equations: StackEquations, weights: np.ndarray) -> np.ndarray:
    """Newton direction of the LQ problem with 60 digits, scaled coordinates."""
    import mpmath

    outer = np.outer(equations.scales, equations.scales)
    P = equations.basis.matrix(weights)
    A = game.A * equations.scales[None, :] / equations.scales[:, None]
    with mpmath.workdps(60):
        A_, P_ = mpmath.matrix(A.tolist()), mpmath.matrix(P.tolist())
        S_, Q_ = mpmath.matrix((game.S_control / outer).tolist()), mpmath.matrix((game.Q * outer).tolist())
        closed, residual = A_ - S_ * P_, A_.T * P_ + P_ * A_ + Q_ - P_ * S_ * P_
        n = len(A)
        operator = mpmath.zeros(n * n)
        for i in range(n):
            for j in range(n):
                for k in range(n):
                    operator[i * n + j, k * n + j] += closed[k, i]
                    operator[i * n + j, i * n + k] += closed[k, j]
        flat = mpmath.matrix([residual[i, j] for i in range(n) for j in range(n)])
        step = mpmath.lu_solve(operator, flat)
        return equations.basis.weights(np.array([float(x) for x in step]).reshape(n, n))


def test_near_the_edge_a_truncated_pseudo_inverse_points_elsewhere() -> None:
    """Why directions come from QR: the singular value that a tolerance drops is the one that matters."""
    game, exact = lq(PUBLISHED[1])
    errors = []
    for seed in range(3):
        equations = build(game, seed=seed)
        weights = equations.scaled(start_at_the_edge(game, exact.P, seed, margin=1e-11))
        found = equations.at(weights, LQ)
        n = np.sqrt(1.0 + np.sum(found.regressors**2, axis=1))
        truncated = np.linalg.pinv(found.regressors / n[:, None]) @ (found.residuals / n)
        right = exact_direction(game, equations, weights)
        errors.append([relative_error(step, right) for step in (truncated, newton_step(found, n))])
    truncated_errors, qr_errors = np.array(errors).T
    assert np.median(truncated_errors) > 0.9
    assert np.median(qr_errors) < 0.02


@pytest.mark.parametrize("margin", [1e-1, 1e-4, 1e-8, 1e-12])
def test_starts_at_the_edge_of_stability_end_at_the_solution(margin: float) -> None:
    for seed in range(4):
        game, exact = published(PUBLISHED[seed % 2])
        start = tuple(start_at_the_edge(game, exact.P, seed, margin))
        assert_exact(learn(game, seed=seed, tick=0.2, initial_weights=start), exact)


def test_without_the_discount_at_the_edge_an_answer_is_lost_or_refused(monkeypatch: pytest.MonkeyPatch) -> None:
    """The planted cause: truncated directions, and every start with a negative abscissa trusted."""

    def truncated(found: Any, normaliser: np.ndarray) -> np.ndarray:
        rows, right = found.regressors / normaliser[:, None], found.residuals / normaliser
        step: np.ndarray = np.linalg.pinv(rows) @ right
        return step

    def unguarded(equations: StackEquations, here: Point, step: np.ndarray, fraction: float) -> Point:
        return here._replace(weights=here.weights - fraction * step)

    monkeypatch.setattr(certified, "RELATIVE_MARGIN", 0.0)
    monkeypatch.setattr(certified, "newton_step", truncated)
    monkeypatch.setattr(certified, "stabilizing_step", unguarded)
    ends = []
    for seed in (4, 5):
        game, exact = lq(PUBLISHED[seed % 2])
        start = tuple(start_at_the_edge(game, exact.P, seed, margin=1e-11))
        try:
            result = learn(game, seed=seed, tick=0.2, initial_weights=start)
        except NoSolutionError:
            ends.append("refused")
            continue
        right = relative_error(result.P, exact.P) <= 1e-9
        assert result.converged == right
        ends.append("right" if right else "failed")
    assert "failed" in ends or "refused" in ends


# No solution, and bad requests.


@pytest.mark.parametrize("name", PUBLISHED)
def test_too_small_a_delta_is_refused_with_the_smallest_one(name: str) -> None:
    game, _ = published(name)
    with pytest.raises(NoSolutionError, match=r"delta = 50 is out of reach.*raise delta") as refusal:
        learn(game.with_delta(50.0), tick=0.1)
    least = float(str(refusal.value).split("lost at delta = ")[1].split(";")[0])
    assert reference_solution(game.with_delta(1.001 * least)).exists
    assert not reference_solution(game.with_delta(0.999 * least)).exists
    assert learn(game.with_delta(1.001 * least), tick=0.1).converged
    with pytest.raises(NoSolutionError, match="out of reach"):
        learn(game.with_delta(0.999 * least), tick=0.1)


def test_a_plant_that_no_input_stabilizes_is_refused() -> None:
    game = Game(A=np.diag([0.3, -1.0]), B=[[0.0], [1.0]], E=np.eye(2), Q=np.eye(2), R=[[1.0]], delta=np.inf)
    with pytest.raises(NoSolutionError, match=r"cannot be lowered below 0\.3.*stabilizable"):
        learn(game, tick=0.1)


@pytest.mark.parametrize(
    ("options", "message"),
    [
        ({"predefined_time": 0.0}, "predefined_time is 0.0"),
        ({"tick": 11.0}, "tick is 11.0 s; it must not exceed predefined_time"),
        ({"eta": 1.0}, "eta is 1.0"),
        ({"samples": 20}, "20 samples cannot determine 21 weights"),
        ({"samples": 30.5}, "samples is 30.5"),
        ({"pool_samples": 40}, "the pool holds 40 samples and 50 were asked for"),
        ({"pool_samples": 10**11}, "pool_samples is 100000000000; give a whole number from 1 to 100000"),
        ({"pool": 40}, "pool must be a Stack"),
        ({"basis": "cubic"}, "unknown basis 'cubic'"),
        ({"initial_weights": (1.0, 2.0)}, "there are 2 initial_weights; basis 'quadratic' has 21"),
        ({"initial_weights": np.nan}, r"initial_weights\[0\] is nan"),
        ({"gamma": 0.01}, "law 'certified' has no setting 'gamma'; choose from predefined_time, tick"),
        ({"law": "magic"}, "unknown law 'magic'; choose from certified"),
    ],
)
def test_bad_requests_name_the_setting(options: dict[str, Any], message: str) -> None:
    with pytest.raises(BadInputError, match=message):
        learn(published(PUBLISHED[0])[0], **options)


def test_time_is_cut_at_the_predefined_time() -> None:
    game, exact = published(PUBLISHED[0])
    result = learn(game, predefined_time=1.0, tick=0.3)
    assert result.times == pytest.approx([0.0, 0.3, 0.6, 0.9, 1.0])
    assert_exact(result, exact)


def test_a_law_is_a_value() -> None:
    """Advancing twice from the same memory gives the same bits and leaves the memory alone."""
    game, _ = published(PUBLISHED[0])
    law: CertifiedLaw = certified_law(game, CertifiedSettings(tick=0.1), seed=0)
    memory = law.start()
    before = memory[0].weights.copy()
    once, again = law.advance(0, memory), law.advance(0, memory)
    assert np.array_equal(once[0].weights, again[0].weights)
    assert np.array_equal(before, memory[0].weights)
    assert not np.array_equal(once[0].weights, memory[0].weights)
