"""What a solution and its report state, compared with its gains, in both times."""

import cmath
import math

import numpy as np
import pytest

from controller.riccati.smallest_delta import DeltaMin
from hfa import BadInputError, Game, solve

#: Sample time, discount and delta.
CASES = [(None, 1.0, 3.0), (True, 0.9, 9.0), (0.1, 1.0, math.inf), (None, 1.0, math.inf)]


@pytest.fixture(params=CASES)
def solution(request):
    dt, discount, delta = request.param
    A, B = [[1.0, 0.5], [-0.3, -2.0 if dt is None else 0.6]], [[1.0, 0.2], [0.5, -0.4]]
    N = [[0.1, 0.0], [0.2, 0.3]] if math.isfinite(delta) else None
    weights = {"Q": [2.0, 1.0], "R": [2.0, 3.0], "N": N, "delta": delta}
    return solve(Game(A, B, E=[[0.3], [1.0]], **weights, dt=dt, discount=discount))


def test_a_solution_states_the_poles_and_gains_of_its_loops(solution):
    """The poles are those of both loops, the L2 gain is the largest one of all frequencies, and the
    weights of H are those of one step.
    """
    game, K, P = solution.game, solution.K, solution.P
    loop = game.A - game.B @ K
    for stated, matrix in (
        (solution.closed_loop_eigenvalues, loop),
        (solution.worst_case_eigenvalues, loop + game.E @ solution.disturbance_gain),
    ):
        np.testing.assert_allclose(stated, np.sort_complex(np.linalg.eigvals(matrix)), rtol=1e-9)
    s = np.exp(1j * np.linspace(0.0, math.pi, 10001))
    s = s if game.is_discrete else (s - 1.0) / (s + 1.0 + 1e-9)
    root = math.sqrt(game.discount)
    z = np.linalg.solve(s[:, None, None] * np.eye(2) - root * loop, root * game.E)
    cost = game.Q + K.T @ game.R @ K - game.N @ K - K.T @ game.N.T
    gain = math.sqrt(np.linalg.eigvalsh(z.conj().swapaxes(1, 2) @ cost @ z).max())
    low, high = solution.l2_gain_bounds
    assert gain * (1.0 - 1e-12) <= high <= low * (1.0 + 1e-6) <= gain * (1.0 + 1e-5)
    assert solution.delta_margin == solution.delta / solution.delta_min
    assert solution.cost([3.0, 1.0]) == pytest.approx([3.0, 1.0] @ P @ [3.0, 1.0])
    with pytest.raises(BadInputError, match=r"give an array of shape \(2,\)"):
        solution.cost([3.0])
    B = game.B * root
    weight = game.R + B.T @ P @ B if game.is_discrete else game.R
    np.testing.assert_allclose(solution.suboptimality_weight, weight, rtol=1e-12)


def test_each_margin_is_the_change_of_an_input_that_is_not_stable(solution):
    """With a factor at its margin at one input, a pole is on the boundary of stability. The disk of
    all inputs is at most that of one.
    """
    game, K = solution.game, solution.K
    assert list(solution.loop_margins) == ["u1", "u2"]
    for i, (low, high, phase, *_, disk) in enumerate(solution.loops):
        assert solution.disk_margin.disk <= disk * (1.0 + 1e-9)
        turns = [cmath.rect(1.0, -math.radians(phase))] if math.isfinite(phase) else []
        for factor in (low, high, *turns):
            if 0.0 < abs(factor) < math.inf:
                factors = np.where(np.arange(2) == i, factor, 1.0)
                poles = np.linalg.eigvals(game.A - game.B * factors @ K)
                last = np.abs(poles).max() - 1.0 if game.is_discrete else poles.real.max()
                assert abs(last) < 1e-6


@pytest.mark.parametrize(
    ("delta", "says"),
    [
        (0.5, "below delta_min = 1; choose a larger delta"),
        (1.0 - 5e-7, "at delta_min, which is between 0.999999 and 1; choose a larger delta"),
        (1.005, "only 0.5 % above delta_min = 1; choose a larger delta"),
        (2.0, "well above delta_min = 1"),
    ],
)
def test_a_delta_is_compared_with_the_smallest_one(delta, says):
    """The advice says where a delta is, and to choose a larger one unless it is well above."""
    assert DeltaMin(1.0, 1.0 - 1e-6).advice(delta) == f"delta = {delta:.9g} is {says}"


def test_a_report_states_what_is_known_of_a_solution(solution):
    """Title, poles, weights, margins and certificate have the numbers of the solution, and only the
    parts that its game has.
    """
    game, text = solution.game, str(solution.report())
    is_disturbed, has_discount = math.isfinite(game.delta), game.discount != 1.0
    disk, loop = solution.disk_margin, solution.loops[1]
    radius = np.abs(solution.poles()).max()
    for fragment, is_there in (
        (f"delta {game.delta:.6g}, smallest possible {solution.delta_min:.7g}, margin", True),
        ("solution in discrete time for", game.is_discrete),
        (f"discount {game.discount:g} a step", has_discount),
        (f"stabilizes: A - B K has the spectral radius {radius:.7g}", game.is_discrete),
        (f"(A - B K) {math.sqrt(game.discount) * radius:.7g}", has_discount),
        ("closed loop A - B K, 1/s", not game.is_discrete),
        ("\nQ diag(2, 1)\nR diag(2, 3)\n", True),
        ("\nN ", game.N.any()),
        ("\nN [0.1 0; 0.2 0.3]", game.N.any()),
        ("A - B K + E L", is_disturbed),
        ("sqrt(discount) (A - B K)", has_discount),
        ("Hurwitz, and P is positive", not game.is_discrete),
        ("the disturbance pays", game.is_discrete and is_disturbed),
        ("L is enclosed", is_disturbed),
        (f"disk {disk.disk:.4g}, gain {disk.gain:.4g}, phase {disk.phase:.4g} deg", True),
        (" rad/step", game.dt is True),
        (" rad/s\n", game.dt is not True),
    ):
        assert (fragment in text + "\n") == is_there, fragment
    *_, row = (line.split() for line in text.splitlines() if line.startswith("u2 "))
    gains = [f"{gain:.3g}" for gain in (loop.gain_low, loop.gain_high)]
    assert row == ["u2", gains[0], "to", gains[1], f"{loop.phase:.4g}", f"{loop.disk:.4g}"]
