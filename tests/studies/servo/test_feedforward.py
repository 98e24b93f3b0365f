"""The convex program of a feedforward: nothing is better, its rates are kept, and its flights are those of the loop."""

from __future__ import annotations

import math
import re
import sys
from collections.abc import Callable
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import model_at
from scipy.linalg import expm
from scipy.optimize import minimize
from servo_cases import A_Z, measured_servo

from controller import ScheduledController, load_controller, load_design
from controller.design.design import Actuator
from controller.design.servo_loop import servo_plant
from hfa_model import Aircraft
from hfa_support import BadInputError, NoSolutionError
from studies.servo import __main__, feedforward
from studies.servo.feedforward import GAP, SECONDS, Feedforward, command_rates, shaped_design, with_feedforward
from studies.servo.flights import fly_commands
from studies.servo.search import quick_controller
from studies.servo.tuning import DESIGNS, design_entries

WHOLE, WEAK = Actuator(), Actuator(bandwidth=0.6, effectiveness=0.25)
#: Of dihedral, rad/s per rad.
RATE = 0.3


@cache
def plain(state: bool = False) -> ScheduledController:
    design = load_design("simvfa-1") if state else measured_servo()
    return quick_controller(Aircraft(), model_at(11.0), design)


def shaped(**changed: Any) -> ScheduledController:
    settings = {"actuators": {"whole": WHOLE, "weak": WEAK}, "rates": {"dihedral": RATE}}
    return with_feedforward(Aircraft(), [model_at(11.0)], plain(), Feedforward(**(settings | changed)))[0]


def after_a_step(table: ScheduledController, actuator: Actuator) -> tuple[float, float]:
    """rms error of dihedral and fastest input, rad/s, after its command goes to 1 rad, in a linear flight."""
    plant = servo_plant(Aircraft(), model_at(11.0), table, dict.fromkeys(table.inputs, actuator))
    flown = fly_commands(plant, table, np.array([[1.0, 0.0]]), SECONDS, Feedforward())
    return flown[0]["dihedral"], flown[1]


def cost(table: ScheduledController) -> float:
    """Of a step of dihedral, A_z without weight."""
    return sum(after_a_step(table, actuator)[0] ** 2 for actuator in (WHOLE, WEAK))


def test_it_makes_the_error_small_with_either_actuator_and_keeps_the_rate() -> None:
    found = shaped(weights={A_Z: 0.0})
    before, after = ([after_a_step(table, each) for each in (WHOLE, WEAK)] for table in (plain(), found))
    assert after[0][0] < 0.8 * before[0][0]
    assert after[1][0] < 0.8 * before[1][0]
    assert max(rate for _, rate in after) == pytest.approx(RATE, rel=1e-4)


def test_for_the_actuators_as_they_are_it_halves_the_error() -> None:
    ends = np.column_stack([np.radians([1.0, 2.0, -1.0]), [-1.0, 1.0, 0.0]])
    plant = servo_plant(Aircraft(), model_at(11.0), plain(), dict.fromkeys(plain().inputs, WHOLE))
    made = shaped(weights={A_Z: 0.0}, actuators={"designed": WHOLE}, rates={})
    before, after = (fly_commands(plant, table, ends, 70.0, Feedforward())[0]["dihedral"] for table in (plain(), made))
    assert after < 0.5 * before


def test_no_other_answer_is_better() -> None:
    """Where no rate is limited a general minimizer finds the same; a little away from it the error is larger."""
    found = shaped(weights={A_Z: 0.0}, rates={}, stages=2)

    def with_gains(gains: np.ndarray) -> ScheduledController:
        C = found.C.copy()
        C[0, :, :2] = gains.reshape(2, 2)
        return replace(found, C=C)

    best = found.C[0, :, :2].ravel()
    other = minimize(lambda gains: 1e3 * cost(with_gains(gains)), 0.9 * best, tol=1e-12)
    assert 1e3 * cost(found) <= other.fun * (1.0 + 1e-6)
    np.testing.assert_allclose(other.x, best, rtol=2e-2)


def test_the_certificate_fails_where_an_answer_is_not_the_best(monkeypatch: pytest.MonkeyPatch) -> None:
    asked = Aircraft(), [model_at(11.0)], plain(), Feedforward(actuators={"weak": WEAK}, rates={"dihedral": RATE})
    checks = with_feedforward(*asked)[1]
    assert [check.name for check in checks] == ["feedforward_dihedral", f"feedforward_{A_Z}"]
    assert all(check.ok for check in checks)
    assert max(abs(check.value) for check in checks) < 1e-3 * GAP
    conic = feedforward.ca.conic

    def planted(*of: Any) -> Any:
        solver = conic(*of)

        def solved(**problem: Any) -> dict[str, Any]:
            return {**solver(**problem), "x": 1.02 * solver(**problem)["x"]}

        solved.stats = solver.stats  # type: ignore[attr-defined]
        return solved

    monkeypatch.setattr(feedforward.ca, "conic", planted)
    assert not any(check.ok for check in with_feedforward(*asked)[1])


@pytest.mark.parametrize("state", [True, False])
def test_a_feedforward_is_added_to_what_is_fed_back(state: bool) -> None:
    """The rest of the controller stays as it is; the stages rest at r_end, one by one."""
    before = plain(state)
    told, _ = with_feedforward(Aircraft(), [model_at(11.0)], before, Feedforward(stages=3))
    p, n = len(before.measurements), len(before.states)
    for part, rows, columns in (("A", n, n), ("B", n, p + 2), ("C", 2, n), ("D", 2, p + 2), ("W", n, 2)):
        place = slice(-columns, None) if part in "AC" else slice(columns)
        np.testing.assert_array_equal(getattr(told, part)[0, -rows:, place], getattr(before, part)[0])
    for nothing in (told.A[0, 6:, :6], told.B[0, :6, : p + 2], told.W[0, :6]):
        assert not nothing.any()
    rest = np.linalg.solve(told.A[0, :6, :6], -told.B[0, :6, p + 2 :])
    np.testing.assert_allclose(rest, np.kron(np.eye(2), np.ones((3, 1))))
    assert told.commands == (*before.commands, "dihedral_command_end", f"{A_Z}_command_end")
    assert told.states[2:4] == ("dihedral_command_end_lag_3", f"{A_Z}_command_end_lag_1")
    assert (told.states[6:], told.command_filter) == (before.states, (0.5, 2.0))


@pytest.mark.parametrize(
    "changed",
    [
        {"lag": 1e300},
        {"weights": {"dihedral": 0.0, A_Z: 0.0}},
        {"actuators": {"wild": Actuator(bandwidth=1e6, effectiveness=1e6)}},
    ],
)
def test_a_feedforward_that_moves_nothing_is_said(changed: dict[str, Any]) -> None:
    with pytest.raises(NoSolutionError, match="moves the errors of dihedral by nothing, or by infinity"):
        shaped(**changed)


def test_a_rate_that_cannot_be_kept_is_said() -> None:
    with pytest.raises(NoSolutionError, match=r"no feedforward keeps the inputs below 0.001 for each unit of dihedral"):
        shaped(rates={"dihedral": 1e-3})


def test_the_command_filter_goes_to_its_end_as_its_equation_says() -> None:
    S = command_rates(Feedforward(bandwidth=0.5, damping=2.0), 1)
    np.testing.assert_allclose(np.sort(np.linalg.eigvals(S)), [-1.8660254, -0.1339746, 0.0], atol=1e-7)
    np.testing.assert_allclose(expm(200.0 * S) @ [0.0, 0.0, 3.0], [3.0, 0.0, 3.0], atol=1e-9)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: Feedforward(damping=math.inf), "the damping of a feedforward is inf; it must"),
        (lambda: Feedforward(stages=2.5), "the stages of a feedforward are 2.5; give a whole number from 1 to 12"),
        (lambda: Feedforward(actuators={}), "a feedforward has no actuators to be made for; name one"),
        (lambda: Feedforward(importance={"weak": 1.0}), "the feedforward has no actuators 'weak'; choose from"),
        (lambda: Feedforward(rates={"dihedral": 0.0}), "the rate of dihedral of a feedforward is 0.0; it must"),
        (lambda: of_table({"lag": 0}), "own.toml: feedforward: the lag of a feedforward is 0"),
        (lambda: of_table({"lags": 1}), "own.toml: unknown entry feedforward.lags; did you mean lag?"),
        (lambda: of_table({"rates": {"dihedrl": 1.0}}), "own.toml: feedforward: unknown output 'dihedrl'"),
        (
            lambda: of_table({"actuators": {"weak": {"order": 3}}}),
            "own.toml: feedforward.actuators.weak: the order of an actuator is 3",
        ),
        (lambda: load_design(DESIGNS["servo-gusts"]), "has no table [feedforward]; remove it, or make the"),
    ],
)
def test_what_is_wrong_is_named(make: Callable[[], object], message: str) -> None:
    with pytest.raises(BadInputError, match=re.escape(message)):
        make()


def of_table(table: dict[str, Any]) -> Feedforward | None:
    return shaped_design("own.toml", {**design_entries("simvfa-1"), "feedforward": table})[1]


def test_the_table_of_a_file() -> None:
    table = {"lag": 0.5, "actuators": {"weak": {"order": 2, "bandwidth": 1.5}}, "rates": {"dihedral": 0.3}}
    assert of_table(table) == Feedforward(0.5, actuators={"weak": Actuator(2, 1.5)}, rates={"dihedral": 0.3})
    assert shaped_design("simvfa-1", design_entries("simvfa-1")) == (load_design("simvfa-1"), None)


@pytest.mark.slow
def test_the_command_writes_a_controller_of_hfa_fly(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(sys, "argv", ["studies.servo", "design", "servo-gusts", "-o", str(tmp_path / "gusts.npz")])
    assert __main__.main() == 0
    made = load_controller(tmp_path / "gusts.npz")
    assert (len(made.dihedrals), made.command_filter) == (21, (0.5, 2.0))
    assert made.about["provenance"]["command"].startswith("python -m studies.servo design servo-gusts")
