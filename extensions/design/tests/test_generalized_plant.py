"""Controllers of generalized plants, and refused plants.

The results are compared with slycot, closed forms, 60-digit solutions and LQG.
"""

from __future__ import annotations

import json
import math
from dataclasses import replace
from typing import Any

import control
import numpy as np
import pytest

pytest.importorskip("hfa_design")

from cli import hfa
from known_models import model_at
from pages import printed_matrices
from plant_references import gain_of, of_slycot, random_plant, smallest_of
from reference_riccati import reference_solution, relative_error
from servo_cases import simvfa_design
from tolerances import SAME_FORMULA, TWO_BRACKETS

from controller import minimum_delta
from hfa import BadInputError, Game, Model, NoSolutionError, solve
from hfa_design import (
    GeneralizedPlant,
    closed_plant,
    design_model,
    solution_of_plant,
    solve_plant,
)

DOUBLE = {"A": [[0.0, 1.0], [0.0, 0.0]], "B1": [[0.0, 0.0], [1.0, 0.0]], "B2": [[0.0], [1.0]]}
DOUBLE |= {
    "C1": [[1.0, 0.0], [0.0, 0.0]],
    "D12": [[0.0], [1.0]],
    "C2": [[1.0, 0.0]],
    "D21": [[0.0, 0.1]],
}


@pytest.mark.parametrize("seed", [9, pytest.param(8, marks=pytest.mark.slow)])
def test_x_and_y_equal_60_digit_solutions(seed: int) -> None:
    """X and Y satisfy the general Riccati equations (Theorem 17.1) and equal 60-digit solutions.

    The policies of the plant with measured states follow from them. The tolerance is 1e-10. In the equations, R = [D11 D12]'[D11 D12] - blkdiag(δ² I, 0).
    """
    plant = random_plant(seed)
    delta = 1.2 * smallest_of(seed).value
    found: Any = solve_plant(plant, delta)
    transposed = plant.transposed()
    for each, X in ((plant, found.X), (transposed, found.Y)):
        B = np.hstack([each.B1, each.B2])
        D = np.hstack([each.D11, each.D12])
        k = each.B1.shape[1]
        m = each.B2.shape[1]
        R = D.T @ D - np.diag(np.repeat([delta**2, 0.0], [k, m]))
        crossed = X @ B + each.C1.T @ D
        terms = (
            each.A.T @ X + X @ each.A,
            each.C1.T @ each.C1,
            -crossed @ np.linalg.solve(R, crossed.T),
        )
        assert np.abs(sum(terms)).max() <= 1e-10 * max(np.abs(term).max() for term in terms)
        reference = reference_solution(each.sides[0].game(delta))
        assert reference.exists
        assert relative_error(X, reference.P) < 1e-10
        # With all states measured, w and u are stationary in the Hamiltonian.
        policies = -np.linalg.solve(R, crossed.T)
        measured = GeneralizedPlant(each.A, each.B1, each.B2, each.C1, each.D12, D11=each.D11)
        gains = solve_plant(measured, delta)
        assert relative_error(gains.disturbance_gain, policies[:k]) < 1e-9
        assert relative_error(-gains.K, policies[k:]) < 1e-9


def test_state_feedback_equals_the_game(game: Game) -> None:
    """Without cross terms, the smallest delta and both gains of the plant are those of the game."""
    n, m = game.B.shape
    root = np.sqrt(np.diag(game.Q))
    C1 = np.vstack([np.diag(root), np.zeros((m, n))])
    D12 = np.vstack([np.zeros((n, m)), np.sqrt(game.R)])
    plant = GeneralizedPlant(game.A, game.E, game.B, C1, D12)
    # Two searches, within 2.5e-7 and 1e-6. Q is computed as the square of a root.
    assert plant.minimum_delta().value == pytest.approx(minimum_delta(game).value, rel=3e-6)
    found = solve_plant(plant, game.delta)
    exact = solve(game)
    # The plant's Q is the square of a root, whose rounding is multiplied by the condition of the
    # game, 1e4.
    assert relative_error(found.K, exact.K) < 1e-10
    assert relative_error(found.disturbance_gain, exact.disturbance_gain) < 1e-10


@pytest.mark.parametrize("seed", [pytest.param(3, marks=pytest.mark.slow), 5])
def test_state_feedback_is_the_limit_of_measurements(seed: int) -> None:
    """delta_min of state feedback is the limit of delta_min for measurements of all states.

    The noise of the measurements tends to 0. The plant has cross terms and D11. delta_min is at
    least |D11|, because a gain u = -K x does not measure w.
    """
    plant = random_plant(seed, 0.3)
    state = replace(plant, C2=None, D21=None, D22=None)
    smallest, (n, k) = state.minimum_delta(), plant.B1.shape
    assert smallest.value >= np.linalg.norm(plant.D11, 2)
    r = len(plant.C1)
    D21 = np.hstack([np.zeros((n, k)), 1e-4 * np.eye(n)])
    noisy = GeneralizedPlant(
        plant.A, np.hstack([plant.B1, np.zeros((n, n))]), plant.B2, plant.C1, plant.D12, np.eye(n), D21,
        np.hstack([plant.D11, np.zeros((r, n))]),
    )  # fmt: skip
    assert smallest.value == pytest.approx(noisy.minimum_delta().value, rel=1e-4)
    found: Any = solve_plant(state, 1.01 * smallest.value)
    loop = control.ss(
        plant.A - plant.B2 @ found.K, plant.B1, plant.C1 - plant.D12 @ found.K, plant.D11
    )
    assert control.linfnorm(loop)[0] < 1.01 * smallest.value
    assert loop.poles().real.max() < 0.0


@pytest.mark.slow
def test_d22_does_not_change_the_closed_loop() -> None:
    """With and without D22, the smallest delta and the closed loop are equal."""
    plant = random_plant(8)
    smallest = smallest_of(8).value
    without = replace(plant, D22=np.zeros_like(plant.D22))
    # Two searches, each within 2.5e-7, and the rounding due to D22.
    assert without.minimum_delta().value == pytest.approx(smallest, rel=TWO_BRACKETS)
    loops = []
    for each in (plant, without):
        found: Any = solve_plant(each, 2.0 * smallest)
        loops.append(closed_plant(each, (found.Ak, found.Bk, found.Ck, found.Dk)))
    for one, other in zip(*loops, strict=True):
        np.testing.assert_allclose(one, other, atol=1e-9 * np.abs(other).max())


def transfer(numerators: list, denominators: list) -> Any:
    return control.tf2ss(control.tf(numerators, denominators))


def with_noise(system: Any, size: float) -> GeneralizedPlant:
    """Return the generalized plant of a system with one y and one u, with noise added to y.

    size: gain of the noise
    """
    A, B, C, D = (np.asarray(getattr(system, name)) for name in "ABCD")
    k = B.shape[1] - 1
    B = np.insert(B, k, 0.0, axis=1)
    D = np.insert(D, k, 0.0, axis=1)
    D[-1, k] = size
    return GeneralizedPlant.from_control(control.ss(A, B, C, D), 1, 1)


def python_control_367() -> Any:
    """Return the system of python-control issue 367: mass, spring and damper, given to hinfsyn.

    The disturbance w has no direct effect on the measurement y.
    """
    damped = [1.0, 12.0, 20.0]
    return transfer(
        [[[-1.0], [-1.0]], [[0.0], [1.0]], [[-1.0], [-1.0]]],
        [[[1.0, 1.0], damped], [[1.0], [1.0]], [[1.0, 1.0], damped]],
    )


def octave_13() -> Any:
    """Return the system of Octave control issue 13: a double integrator in each of four blocks.

    u moves unstable modes that y does not measure.
    """
    one = control.ss(DOUBLE["A"], DOUBLE["B2"], [[1.0, 0.0]], 0.0)
    A = np.kron(np.eye(4), one.A)
    B = np.zeros((8, 2))
    C = np.zeros((3, 8))
    B[[1, 5], 0], B[[3, 7], 1] = 1.0, 1.0
    C[0, [0, 2]], C[2, [4, 6]] = 1.0, 1.0
    return control.ss(A, B, C, [[0.0, 0.0], [0.0, 1.0], [0.0, 0.0]])


def octave_14(weighted: bool = True) -> Any:
    """Return the system of Octave control issue 14: one double integrator.

    The disturbance w has no direct effect on the measurement y.

    weighted: whether u has the weight 10 (s + 1) / (s + 100)
    """
    plain = control.ss(
        DOUBLE["A"],
        [[0.0, 0.0], [1.0, 1.0]],
        [[1.0, 0.0], [0.0, 0.0], [1.0, 0.0]],
        [[0, 0], [0, 1], [0, 0]],
    )
    weight = control.tf2ss(control.tf([10.0, 10.0], [1.0, 100.0]))
    one = control.ss([], [], [], [[1.0]])
    return control.append(one, weight, one) * plain if weighted else plain


def test_plants_of_public_issues_are_refused_by_name() -> None:
    """Plants from public issues that violate an assumption are refused. The message names the
    assumption.
    """
    for system in (python_control_367(), octave_13(), octave_14()):
        with pytest.raises(
            BadInputError,
            match=r"D21 .* row 1",
        ):
            GeneralizedPlant.from_control(system, 1, 1)
    no_cost = control.ss(
        DOUBLE["A"], [[0.0, 0.0], [1.0, 1.0]], [[1.0, 0.0], [1.0, 0.0]], np.zeros((2, 2))
    )
    with pytest.raises(BadInputError, match=r"D12 .* column 1"):
        GeneralizedPlant.from_control(no_cost, 1, 1)
    with pytest.raises(NoSolutionError, match=r"no input reaches the mode with eigenvalue 0,"):
        with_noise(octave_13(), 0.1).minimum_delta()


@pytest.mark.parametrize("reach", [0.0, 0.1])
def test_an_integrator_without_disturbance_is_named(reach: float) -> None:
    """The message names the integrator of 1.6 / (s (s² + 4.8 s + 1.7)) that no disturbance reaches.

    The plant has weights of S and K S, and rounding errors of 1e-16 to 1e-15 in A, as in the
    results of `augw`. If the disturbance reaches the integrator, delta_min agrees with slycot.
    """
    plant = GeneralizedPlant(
        A=[
            [-7e-4, 0.0, -3.9, -1.6],
            [0.0, -4.8, 1.7, -1.1e-15],
            [0.0, -1.0, 5.7e-16, -4.6e-16],
            [0.0, 0.0, 1.0, -5.8e-16],
        ],
        B1=[[1.0], [reach], [0.0], [0.0]],
        B2=[[0.0], [1.0], [0.0], [0.0]],
        C1=[[0.5, 0.0, -1.6, -0.6], [0.0, 0.0, 0.0, 0.0]],
        D11=[[0.4], [0.0]],
        D12=[[0.0], [0.1]],
        C2=[[0.0, 0.0, -3.9, -1.6]],
        D21=[[1.0]],
    )
    if reach:
        smallest = plant.minimum_delta().value
        assert of_slycot(plant)[0] == pytest.approx(smallest, rel=1e-6)
        return
    with pytest.raises(
        NoSolutionError, match="disturbance does not reach the mode with eigenvalue 0,"
    ):
        plant.minimum_delta()


@pytest.mark.slow
@pytest.mark.parametrize("size", [1e-3, pytest.param(0.1, marks=pytest.mark.slow)])
@pytest.mark.parametrize("system", [python_control_367, octave_14, lambda: octave_14(False)])
def test_public_plants_with_noise_agree_with_slycot(system: Any, size: float) -> None:
    """With noise added, delta_min of the plants from public issues agrees with slycot."""
    plant = with_noise(system(), size)
    smallest = plant.minimum_delta().value
    # This project's search ends within 2.5e-7, SB10AD's within 1e-10.
    assert of_slycot(plant)[0] == pytest.approx(smallest, rel=1e-6)
    assert gain_of(plant, solve_plant(plant, 1.001 * smallest)) < 1.001 * smallest


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore::FutureWarning")
@pytest.mark.parametrize(
    ("plant", "error", "effort", "noise"),
    [
        (
            ([1.0, 1.0], [1.0, 0.5, 4.0]),
            ([2.0, -2.2, 1.0], [3.0, 0.2, 0.01]),
            1.0,
            None,
        ),  # from python-control's examples
        pytest.param(
            ([-1.0, 1.0], [1.0, 2.0, 1.0]),
            ([0.5, 0.2], [1.0, 2e-4]),
            0.1,
            None,
            marks=pytest.mark.slow,
        ),
        (([1.0], [1.0, -1.0]), ([0.5, 1.0], [1.0, 1e-3]), 0.1, None),
        (
            ([1.0], [1.0, 3.02, 1.06, 3.0]),
            ([0.5, 0.3], [1.0, 3e-3]),
            0.1,
            ([1.0, 10.0], [0.01, 100.0]),
        ),
    ],
)
def test_mixed_sensitivity_agrees_with_slycot(
    plant: Any, error: Any, effort: float, noise: Any
) -> None:
    """delta_min of plants with weights of S, K S and T agrees with slycot.

    In these plants D11 is not 0 and D21 is square. Without an unstable pole, Y is exactly 0.
    """
    G, W1, W2 = (control.ss(control.tf(*each)) for each in (plant, error, ([effort], [1.0])))
    W3 = control.ss(control.tf(*noise)) if noise else None
    augmented = GeneralizedPlant.from_control(control.augw(G, W1, W2, W3), 1, 1)
    smallest = augmented.minimum_delta().value
    # This project's search ends within 2.5e-7, SB10AD's within 1e-10.
    assert of_slycot(augmented)[0] == pytest.approx(smallest, rel=1e-6)
    assert gain_of(augmented, solve_plant(augmented, 1.001 * smallest)) < 1.001 * smallest


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        (
            {"C1": [[0.0, 0.0], [0.0, 0.0]]},
            r"z does not observe the mode with eigenvalue .*a zero from u to z on the imag",
        ),
        (
            {"B1": [[0.0, 0.0], [0.0, 0.0]]},
            r"the disturbance does not reach the mode with eigenvalue",
        ),
        ({"B2": [[0.0], [0.0]]}, r"no input reaches the mode with eigenvalue"),
        ({"C2": [[0.0, 0.0]]}, r"the sensors do not observe the mode with eigenvalue"),
        ({"C2": [[0.0, 1.0]]}, r"the sensors do not observe the mode with eigenvalue"),
        ({"A": [[0.0, 1.0], [-1.0, 0.0]], "C1": [[0.0, 0.0], [0.0, 0.0]]}, r"eigenvalue 0 ± 1i"),
    ],
)
def test_modes_without_a_solution_are_named(changes: dict[str, Any], words: str) -> None:
    """If a mode admits no solution for any delta, the refusal names its eigenvalue and the reason."""
    plant = GeneralizedPlant(**DOUBLE | changes)
    for refused in (GeneralizedPlant.minimum_delta, lambda each: solve_plant(each, 1e3)):
        with pytest.raises(NoSolutionError, match=words):
            refused(plant)


def test_rounding_does_not_make_an_integrator_controllable() -> None:
    """Rounding errors that move a double integrator's poles to ±3e-8 do not make it controllable.

    The message names the eigenvalue 0 that the disturbance does not reach.
    """
    e = 6e-16
    plant = GeneralizedPlant(
        A=[
            [-0.002, 0.0, 0.0, -0.9, 0.9],
            [0.0, -1.8, -2.9, e, e],
            [0.0, -10.0, 0.0, -5 * e, e],
            [0.0, 0.0, 1.0, -e, -2 * e],
            [0.0, 0.0, 0.0, -1.0, -e],
        ],
        B1=[[1.0], [0.0], [0.0], [0.0], [0.0]],
        B2=[[0.0], [1.0], [0.0], [0.0], [0.0]],
        C1=[[1.0, 0.0, 0.0, -0.5, 0.5], [0.0] * 5],
        D12=[[0.0], [0.1]],
        C2=[[0.0, 0.0, 0.0, -0.9, 0.9]],
        D21=[[1.0]],
        D11=[[0.5], [0.0]],
    )
    with pytest.raises(NoSolutionError, match="does not reach the mode with eigenvalue 0,"):
        plant.minimum_delta()


@pytest.mark.parametrize(
    ("changes", "words"),
    [
        ({"B2": [[1.0]]}, r"B2 has shape \(1, 1\); give \(2, 1\), to match the other matrices"),
        ({"D12": [[0.0, 1.0]]}, "D12 has shape"),
        ({"D12": [[0.0, 0.0], [1.0, 2.0]], "B2": np.eye(2)}, "D12 has rank 1, but 2 columns"),
        ({"C2": np.eye(2), "D21": [[0.0, 1.0], [0.0, 1.0]]}, "D21 has rank 1, but 2 rows"),
        ({"D21": None}, "D21 is missing"),
        ({"B1": None}, "B1 is missing"),
        ({"A": 5.0}, "the number of dimensions of A is 0"),
        ({"C2": None}, "without C2"),
        ({"C2": None, "D21": None, "D22": [[1.0]]}, "without C2"),
        ({"C2": None, "D22": None}, "without C2"),
        ({"A": [[0.0, math.nan], [0.0, 0.0]]}, r"A\[0\]\[1\] is nan"),
    ],
)
def test_inconsistent_plants_are_refused(changes: dict[str, Any], words: str) -> None:
    """Plants with missing matrices, wrong shapes, ranks or numbers are refused."""
    with pytest.raises(BadInputError, match=words):
        GeneralizedPlant(**DOUBLE | changes)


def test_solve_reads_plant_files(tmp_path: Any) -> None:
    """`hfa solve` solves plants in files, with output and with state feedback, and refuses delta
    below its smallest value.
    """
    path = tmp_path / "plant.json"
    path.write_text(json.dumps(DOUBLE), "utf-8")
    data = json.loads(hfa("solve", "--model", str(path), "--json").out)
    smallest = GeneralizedPlant(**DOUBLE).minimum_delta().value
    assert (data["feedback"], data["delta_min"], data["certificate"]["ok"]) == (
        "output",
        smallest,
        True,
    )
    assert data["delta"] == pytest.approx(1.01 * smallest)
    assert [np.shape(data[name]) for name in ("Ak", "Bk", "Ck", "Dk")] == [
        (2, 2),
        (2, 1),
        (1, 2),
        (1, 1),
    ]
    np.savez(
        tmp_path / "state.npz",
        **{name: DOUBLE[name] for name in ("A", "B1", "B2", "C1", "D12")},
        delta=3.0,
    )
    state = hfa("solve", "--model", str(tmp_path / "state.npz"))
    assert "State feedback u = -K x" in state.out
    assert "delta 3," in state.out
    words = ("solve", "--model", str(tmp_path / "state.npz"), "--json")
    assert json.loads(hfa(*words).out)["delta"] == 3.0
    for words, said, code in (
        (("--delta", "1"), "delta = 1 is below delta_min = 1.286", 1),
        (("--Q", "1,1"), "--Q does not apply to a generalized plant", 2),
        (("--design", "paper"), "--design applies only to the aircraft", 2),
    ):
        refused = hfa("solve", "--model", str(path), *words)
        assert refused.code == code
        assert said in refused.err
        assert refused.err.count("\n") == 1


MEASURED = ("pitch_rate", "dihedral_integral", "vertical_acceleration_short_period_integral")
NOISE = np.diag([1e-4, 1e-4, 1e-2])
ONE = np.eye(1)


@pytest.fixture(
    scope="module", params=["simvfa-1", pytest.param("simvfa-2", marks=pytest.mark.slow)]
)
def servo(
    request: pytest.FixtureRequest, published_aircraft: Model
) -> tuple[Game, np.ndarray, GeneralizedPlant]:
    """Return the game of a servo at 11 deg, the matrix C of three measurements, and the plant.

    The plant is the generalized plant of the game with these measurements. The disturbance acts on
    every state.
    """
    built = design_model(published_aircraft, model_at(11.0), simvfa_design(request.param))
    C = np.array([[float(state == name) for state in built.states] for name in MEASURED])
    game = built.game().with_delta(200.0)
    return game, C, GeneralizedPlant.measured(game, C, NOISE)


def scalar() -> GeneralizedPlant:
    return GeneralizedPlant.measured(
        Game(0.5 * ONE, 2 * ONE, 0.7 * ONE, 3 * ONE, 0.4 * ONE, 1.0), ONE, 0.25 * ONE
    )


def larger_root(a: float, s: float, q: float) -> float:
    """Return the larger root of 2 a p + q - s p² = 0."""
    return (a + math.sqrt(a * a + s * q)) / s


def by_hand(delta: float) -> tuple[float, float]:
    """Return X and Y of the plant `scalar` at delta, in closed form."""
    return larger_root(0.5, 4 / 0.4 - 0.49 / delta**2, 3.0), larger_root(
        0.5, 1 / 0.25 - 3.0 / delta**2, 0.49
    )


def test_a_scalar_plant_equals_hand_computed_values() -> None:
    """X, Y and the controller of a scalar plant equal values computed by hand."""
    X, Y = by_hand(3.0)
    found: Any = solve_plant(scalar(), 3.0)
    gain = Y / 0.25 / (1 - X * Y / 9)
    Ak = 0.5 + 0.49 / 9 * X - 2 * 2 / 0.4 * X - gain
    parts = [found.X[0, 0], found.Y[0, 0], found.coupling, found.Bk[0, 0], found.Ak[0, 0]]
    assert parts == pytest.approx([X, Y, X * Y / 9, gain, Ak], rel=SAME_FORMULA)


def test_scalar_smallest_delta_agrees_with_closed_form() -> None:
    """delta_min of a scalar plant agrees with the closed form and is printed in the report.

    A smaller delta is refused with the condition that fails.
    """
    smallest, refused, condition = scalar().minimum_delta()
    assert refused < smallest <= refused * (1 + 1e-6)
    assert condition == "coupling condition"
    below, above = (
        delta**2 - math.prod(by_hand(delta))
        for delta in (smallest * (1 - TWO_BRACKETS), smallest * (1 + TWO_BRACKETS))
    )
    assert below < 0 < above
    with pytest.raises(NoSolutionError, match="the coupling condition fails: rho"):
        solve_plant(scalar(), smallest * 0.999)
    report = solution_of_plant(scalar(), 3.0, "one state").report()
    assert report.title.endswith(
        f"delta 3, smallest possible {smallest:.7g}, limited by the coupling condition"
    )
    assert report.data["delta_margin"] == pytest.approx(3.0 / smallest)
    with pytest.raises(
        NoSolutionError, match=r"the coupling condition fails: rho.* is below delta_min = "
    ):
        solution_of_plant(scalar(), 0.99 * smallest, "one state")
    free = GeneralizedPlant.measured(
        Game(-0.5 * ONE, 2 * ONE, ONE, 0 * ONE, ONE, 9.0), ONE, 0.25 * ONE
    )
    assert solution_of_plant(free, None, "one state").delta == 1.0
    data = solution_of_plant(free, 9.0, "one state").as_data()
    assert (data["delta_min"], data["delta_margin"], data["coupling"]) == (0.0, math.inf, 0.0)


def test_infinite_delta_gives_lqg(servo: tuple[Game, np.ndarray, GeneralizedPlant]) -> None:
    """With infinite delta, the controller is the LQG controller of python-control."""
    game, C, plant = servo
    found: Any = solve_plant(plant, math.inf)
    K = control.lqr(game.A, game.B, game.Q, game.R)[0]
    L = control.lqe(game.A, np.eye(len(game.A)), C, game.S_disturbance, NOISE)[0]
    for ours, theirs in ((-found.Ck, K), (found.Bk, L), (found.Ak, game.A - game.B @ K - L @ C)):
        # python-control does not refine its results: rounding times the condition of the servo,
        # 1e5.
        assert relative_error(ours, theirs) < 1e-9
    assert found.coupling == 0.0


def test_a_measured_game_with_cross_weights_keeps_its_cost() -> None:
    """|C1 x + D12 u|² is x'Qx + 2x'Nu + u'Ru, and the controller is that of LQG with N."""
    A = np.array([[0.0, 1.0], [2.0, -0.3]])
    B = np.array([[0.0], [1.0]])
    N = np.array([[0.4], [-0.3]])
    game = Game(A=A, B=B, Q=np.eye(2), R=[2.0], N=N)
    C = np.array([[1.0, 0.0]])
    assert GeneralizedPlant.measured(game, C, np.eye(1), [[0.7]]).D22 == 0.7
    plant = GeneralizedPlant.measured(game, C, np.eye(1))
    output = np.hstack([plant.C1, plant.D12])
    weights = np.block([[game.Q, N], [N.T, game.R]])
    assert np.allclose(output.T @ output, weights)
    K = control.lqr(A, B, np.eye(2), np.array([[2.0]]), N)[0]
    L = control.lqe(A, np.eye(2), C, np.eye(2), np.eye(1))[0]
    lqg = control.ss(A - B @ K - L @ C, L, -K, 0)
    solved = solve_plant(plant, math.inf)
    found = control.ss(solved.Ak, solved.Bk, solved.Ck, solved.Dk)
    assert np.allclose(found(1.3j), lqg(1.3j))


@pytest.mark.parametrize(
    ("measured", "slow", "is_refined"), [(True, 1e-3, True), (False, -1e-3, False)]
)
def test_the_printed_controller_stabilizes(measured: bool, slow: float, is_refined: bool) -> None:
    """If four decimals of a controller leave a slow mode unstable, more digits are printed.

    measured: whether the states are measured with noise
    """
    modes = np.array([[0.8, 0.6], [-0.6, 0.8]])
    A = modes @ np.diag([1e3, slow]) @ modes.T
    B = 100.0 * modes @ [[1.0], [1.0]]
    game = Game(A, B, np.eye(2), 1e-12 * np.eye(2), np.eye(1), math.inf)
    plant = GeneralizedPlant.measured(game, np.eye(2), np.eye(2))
    if not measured:
        plant = replace(plant, C2=None, D21=None, D22=None)
    solved = solution_of_plant(plant, math.inf, "plant")
    printed = printed_matrices(solved.report())
    four_decimals = {name: getattr(solved.solution, name).round(4) for name in solved.matrices}
    assert np.linalg.eigvals(solved.loop(printed)).real.max() < 0.0
    assert (np.linalg.eigvals(solved.loop(four_decimals)).real.max() > 0.0) == is_refined
