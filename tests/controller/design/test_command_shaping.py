"""The convex program of a feedforward: nothing is better, its rates are kept, and its flights are those of the loop."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np
import pytest
from known_models import model_at
from scipy.linalg import expm
from scipy.optimize import minimize
from servo_cases import A_Z, measured_servo

from controller import Actuator, Design
from controller.design import command_shaping
from controller.design.command_shaping import GAP, SECONDS, command_rates
from controller.design.controllers import LinearController, controller_at, controller_table
from controller.design.design import Feedforward
from controller.design.servo_loop import servo_plant
from controller.riccati.gare_schur import quick_solution
from hfa_model import Aircraft
from hfa_support import NoSolutionError
from studies.servo.flights import fly_commands

WHOLE, WEAK = Actuator(), Actuator(bandwidth=0.6, effectiveness=0.25)
#: Of dihedral, rad/s per rad.
RATE = 0.3


def design(**changed: Any) -> Design:
    settings = {"actuators": {"whole": WHOLE, "weak": WEAK}, "rates": {"dihedral": RATE}}
    return measured_servo(feedforward=Feedforward(**(settings | changed)))


def made(aircraft: Aircraft, of: Design) -> LinearController:
    return controller_at(aircraft, model_at(11.0), of, "output", quick_solution)


def after_a_step(aircraft: Aircraft, of: Design, found: LinearController, actuator: Actuator) -> tuple[float, float]:
    """rms error of dihedral and fastest input, rad/s, after its command goes to 1 rad, in a linear flight."""
    table = controller_table(aircraft, of, "output", [model_at(11.0)], [found])
    plant = servo_plant(aircraft, model_at(11.0), table, dict.fromkeys(table.inputs, actuator))
    flown = fly_commands(plant, table, np.array([[1.0, 0.0]]), SECONDS, Feedforward())
    return flown[0]["dihedral"], flown[1]


def cost(aircraft: Aircraft, of: Design, found: LinearController) -> float:
    """Of a step of dihedral, A_z without weight."""
    return sum(after_a_step(aircraft, of, found, actuator)[0] ** 2 for actuator in (WHOLE, WEAK))


def test_it_makes_the_error_small_with_either_actuator_and_keeps_the_rate(published_aircraft: Aircraft) -> None:
    plain, shaped = measured_servo(feedforward=None), design(weights={A_Z: 0.0})
    before = [after_a_step(published_aircraft, plain, made(published_aircraft, plain), each) for each in (WHOLE, WEAK)]
    after = [after_a_step(published_aircraft, shaped, made(published_aircraft, shaped), each) for each in (WHOLE, WEAK)]
    assert after[0][0] < 0.8 * before[0][0]
    assert after[1][0] < 0.8 * before[1][0]
    assert max(rate for _, rate in after) == pytest.approx(RATE, rel=1e-4)


def test_no_other_answer_is_better(published_aircraft: Aircraft) -> None:
    """Where no rate is limited a general minimizer finds the same; a little away from it the error is larger."""
    of = design(weights={A_Z: 0.0}, rates={}, stages=2)
    found = made(published_aircraft, of)

    def with_gains(gains: np.ndarray) -> LinearController:
        C = found.C.copy()
        C[:, :2] = gains.reshape(2, 2)
        return replace(found, C=C)

    best = found.C[:, :2].ravel()
    other = minimize(lambda gains: 1e3 * cost(published_aircraft, of, with_gains(gains)), 0.9 * best, tol=1e-12)
    assert 1e3 * cost(published_aircraft, of, found) <= other.fun * (1.0 + 1e-6)
    np.testing.assert_allclose(other.x, best, rtol=2e-2)


def test_the_certificate_fails_where_an_answer_is_not_the_best(
    published_aircraft: Aircraft, monkeypatch: pytest.MonkeyPatch
) -> None:
    checks = made(published_aircraft, design()).checks
    assert [check.name for check in checks] == ["feedforward_dihedral", f"feedforward_{A_Z}"]
    assert all(check.ok for check in checks)
    assert max(abs(check.value) for check in checks) < 1e-3 * GAP
    plain = command_shaping.ca.conic

    def planted(*of: Any) -> Any:
        solver = plain(*of)

        def solved(**problem: Any) -> dict[str, Any]:
            return {**solver(**problem), "x": 1.02 * solver(**problem)["x"]}

        solved.stats = solver.stats  # type: ignore[attr-defined]
        return solved

    monkeypatch.setattr(command_shaping.ca, "conic", planted)
    assert not any(check.ok for check in made(published_aircraft, design()).checks)


@pytest.mark.parametrize(
    "changed",
    [
        {"lag": 1e300},
        {"weights": {"dihedral": 0.0, A_Z: 0.0}},
        {"actuators": {"wild": Actuator(bandwidth=1e6, effectiveness=1e6)}},
    ],
)
def test_a_feedforward_that_moves_nothing_is_said(published_aircraft: Aircraft, changed: dict[str, Any]) -> None:
    with pytest.raises(NoSolutionError, match="moves the errors of dihedral by nothing, or by infinity"):
        made(published_aircraft, design(**changed))


def test_a_rate_that_cannot_be_kept_is_said(published_aircraft: Aircraft) -> None:
    with pytest.raises(NoSolutionError, match=r"no feedforward keeps the inputs below 0.001 for each unit of dihedral"):
        made(published_aircraft, design(rates={"dihedral": 1e-3}))


def test_the_command_filter_goes_to_its_end_as_its_equation_says() -> None:
    S = command_rates(Feedforward(bandwidth=0.5, damping=2.0), 1)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(S)), [-1.8660254, -0.1339746, 0.0], atol=1e-7)
    np.testing.assert_allclose(expm(200.0 * S) @ [0.0, 0.0, 3.0], [3.0, 0.0, 3.0], atol=1e-9)
