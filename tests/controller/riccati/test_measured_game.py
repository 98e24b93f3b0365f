"""The game from measured outputs: against closed forms, 60 digits, LQG and the state-feedback game."""

from __future__ import annotations

import math
from typing import Any

import control
import numpy as np
import pytest
from known_models import model_at
from reference_riccati import reference_solution, relative_error
from servo_cases import simvfa_design

from controller import Game, design_model
from controller.analysis.plant_report import plant_report
from controller.riccati.generalized_plant import square_root
from hfa_model import Aircraft
from hfa_support import BadInputError, NoSolutionError
from verification import GeneralizedPlant, minimum_delta, solve_game, solve_plant

MEASURED = ("pitch_rate", "dihedral_integral", "vertical_acceleration_short_period_integral")
NOISE, ONE = np.diag([1e-4, 1e-4, 1e-2]), np.eye(1)


@pytest.fixture(scope="module", params=["simvfa-1", pytest.param("simvfa-2", marks=pytest.mark.slow)])
def servo(request: pytest.FixtureRequest, published_aircraft: Aircraft) -> tuple[Game, np.ndarray, GeneralizedPlant]:
    """The peer's servo at 11 deg from its three measurements, with a disturbance in every aircraft state."""
    built = design_model(published_aircraft, model_at(11.0), simvfa_design(request.param))
    C = np.array([[float(state == name) for state in built.states] for name in MEASURED])
    game = built.game().with_delta(200.0)
    return game, C, GeneralizedPlant.measured(game, C, NOISE)


def scalar() -> GeneralizedPlant:
    return GeneralizedPlant.measured(Game(0.5 * ONE, 2 * ONE, 0.7 * ONE, 3 * ONE, 0.4 * ONE, 1.0), ONE, 0.25 * ONE)


def larger_root(a: float, s: float, q: float) -> float:
    """Of 2 a p + q - s p² = 0."""
    return (a + math.sqrt(a * a + s * q)) / s


def by_hand(delta: float) -> tuple[float, float]:
    """X and Y of `scalar`."""
    return larger_root(0.5, 4 / 0.4 - 0.49 / delta**2, 3.0), larger_root(0.5, 1 / 0.25 - 3.0 / delta**2, 0.49)


def test_a_scalar_plant_by_hand() -> None:
    X, Y = by_hand(3.0)
    found: Any = solve_plant(scalar(), 3.0)
    gain = Y / 0.25 / (1 - X * Y / 9)
    Ak = 0.5 + 0.49 / 9 * X - 2 * 2 / 0.4 * X - gain
    parts = [found.X[0, 0], found.Y[0, 0], found.coupling, found.Bk[0, 0], found.Ak[0, 0]]
    assert parts == pytest.approx([X, Y, X * Y / 9, gain, Ak], rel=1e-12)


def test_the_smallest_delta_of_a_scalar_plant_and_its_report() -> None:
    smallest, refused, condition = minimum_delta(scalar())
    assert refused < smallest <= refused * (1 + 1e-6)
    assert condition == "coupling condition"
    below, above = (delta**2 - math.prod(by_hand(delta)) for delta in (smallest * (1 - 2e-6), smallest * (1 + 2e-6)))
    assert below < 0 < above
    with pytest.raises(NoSolutionError, match="the coupling condition fails: rho"):
        solve_plant(scalar(), smallest * 0.999)
    report = plant_report(scalar(), 3.0, "one state")
    assert report.title.endswith(f"delta 3, smallest possible {smallest:.7g}, where the coupling condition ends it")
    assert report.data["delta_margin"] == pytest.approx(3.0 / smallest)
    with pytest.raises(NoSolutionError, match=r"the coupling condition fails: rho.* is below delta_min = "):
        plant_report(scalar(), 0.99 * smallest, "one state")
    free = GeneralizedPlant.measured(Game(-0.5 * ONE, 2 * ONE, ONE, 0 * ONE, ONE, 9.0), ONE, 0.25 * ONE)
    data = plant_report(free, 9.0, "one state").data
    assert (data["delta_min"], data["delta_margin"], data["coupling"]) == (0.0, None, 0.0)


def test_both_equations_to_sixty_digits(servo: tuple[Game, np.ndarray, GeneralizedPlant]) -> None:
    game, C, plant = servo
    found: Any = solve_plant(plant, 200.0)
    root = np.diag(np.sqrt(np.diag(game.Q)))
    dual = Game(A=game.A.T, B=C.T, E=root, Q=game.S_disturbance, R=NOISE, delta=200.0)
    for ours, reference in ((found.X, reference_solution(game)), (found.Y, reference_solution(dual))):
        # The sign of Y is lost in the rows of actuators and integrals, which no disturbance reaches: they are 0.
        assert relative_error(ours, reference.P) < 1e-10
    assert all(check.ok for check in found.checks)


def test_without_disturbance_it_is_lqg(servo: tuple[Game, np.ndarray, GeneralizedPlant]) -> None:
    game, C, plant = servo
    found: Any = solve_plant(plant, math.inf)
    K = control.lqr(game.A, game.B, game.Q, game.R)[0]
    L = control.lqe(game.A, np.eye(len(game.A)), C, game.S_disturbance, NOISE)[0]
    for ours, theirs in ((-found.Ck, K), (found.Bk, L), (found.Ak, game.A - game.B @ K - L @ C)):
        assert relative_error(ours, theirs) < 1e-9
    assert found.coupling == 0.0


def test_with_every_state_measured_well_it_is_the_state_feedback_game(game: Game) -> None:
    """As the noise falls the filter's share of the coupling falls, and the smallest delta becomes that of the game."""
    n, smallest = len(game.A), minimum_delta(game).value
    plants = [GeneralizedPlant.measured(game, np.eye(n), noise * np.eye(n)) for noise in (1e-6, 1e-10)]
    excess = [minimum_delta(plant).value / smallest - 1 for plant in plants]
    assert excess[0] > excess[1] > -2e-6
    assert excess[1] < 1e-3
    found: Any = solve_plant(plants[1], game.delta)
    assert relative_error(found.X, solve_game(game).P) < 1e-12


@pytest.mark.parametrize("seed", [0, 2])
def test_units_of_the_states_over_16_decades_change_nothing(seed: int) -> None:
    """z = u y: delta_min, the coupling, the response; X and Y in the new units."""
    rng = np.random.default_rng(seed)
    A, B, E, C = (rng.standard_normal(shape) for shape in ((3, 3), (3, 1), (3, 2), (2, 3)))
    game, u = Game(A=A, B=B, E=E, Q=np.eye(3), R=ONE, delta=1.0), 10.0 ** (8 * np.array([1.0, -1.0, 0.0]))
    scaled = Game(A=A * u / u[:, None], B=B / u[:, None], E=E / u[:, None], Q=np.diag(u * u), R=ONE, delta=1.0)
    one, other = (GeneralizedPlant.measured(each, c, np.eye(2)) for each, c in ((game, C), (scaled, C * u)))
    smallest, found = minimum_delta(one), minimum_delta(other)
    assert found.refused < found.value <= found.refused * (1 + 2e-6)
    assert found.value == pytest.approx(smallest.value, rel=2e-6)
    assert found.condition == smallest.condition
    first: Any = solve_plant(one, 1.01 * smallest.value)
    second: Any = solve_plant(other, 1.01 * smallest.value)
    assert second.coupling == pytest.approx(first.coupling, rel=1e-8)
    np.testing.assert_allclose(second.X / np.outer(u, u), first.X, atol=1e-8 * np.abs(first.X).max())
    np.testing.assert_allclose(second.Y * np.outer(u, u), first.Y, atol=1e-8 * np.abs(first.Y).max())
    np.testing.assert_allclose(second.Ck / u, first.Ck, rtol=1e-6, atol=1e-8 * np.abs(first.Ck).max())


def test_python_control_fails_on_the_servo_and_no_loop_of_its_goes_below(
    servo: tuple[Game, np.ndarray, GeneralizedPlant],
) -> None:
    """It states a gain of 3; the loop that it returns has one of hundreds."""
    pytest.importorskip("slycot")
    game, C, plant = servo
    paid = np.vstack([square_root(game.Q), np.zeros((2, len(C[0]))), C])
    into, D = np.hstack([plant.B1, game.B]), np.zeros((len(paid), plant.B1.shape[1] + 2))
    D[-5:-3, -2:], D[-3:, -5:-2] = np.sqrt(game.R), np.sqrt(NOISE)
    _, loop, stated, _ = control.hinfsyn(control.ss(game.A, into, paid, D), 3, 2)
    resolvents = (1j * w * np.eye(len(loop.A)) - loop.A for w in np.geomspace(1e-4, 1e4, 1000))
    reached = max(np.linalg.norm(loop.C @ np.linalg.solve(each, loop.B) + loop.D, 2) for each in resolvents)
    smallest = minimum_delta(plant).value
    assert stated < 4.0 < smallest
    assert reached >= smallest * (1 - 1e-6)


def test_noise_without_a_size_is_refused() -> None:
    with pytest.raises(BadInputError, match="V is not positive definite"):
        GeneralizedPlant.measured(Game(ONE, ONE, ONE, ONE, ONE, 1.0), ONE, 0 * ONE)
