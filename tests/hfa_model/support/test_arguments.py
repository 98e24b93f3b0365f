"""An argument of the wrong kind is named in one line, at every door."""

from __future__ import annotations

import inspect
import math
import pickle
from collections.abc import Callable
from dataclasses import dataclass
from types import FunctionType
from typing import Any

import numpy as np
import pytest

import controller
import hfa_model
import trim
import verification
from hfa_model import DEGREE, Aircraft, BadInputError
from hfa_model.support.arguments import explained, explained_class

DOORS = (hfa_model, trim, controller, verification)
FUNCTIONS = {
    f"{door.__name__}.{name}": found
    for door in DOORS
    for name in door.__all__
    if isinstance(found := getattr(door, name), FunctionType)
    and any(each.default is each.empty for each in inspect.signature(found).parameters.values())
}
#: These keep what they are given; who uses what they make refuses it.
LATER = {"hfa_model.shown_in", "controller.side_by_side", "verification.make_setting"}


@pytest.mark.parametrize("name", sorted(FUNCTIONS.keys() - LATER))
def test_what_is_of_no_kind_is_refused_in_one_line_by_every_function(name: str) -> None:
    required = [
        each
        for each in inspect.signature(FUNCTIONS[name]).parameters.values()
        if each.default is each.empty and each.kind is not each.VAR_KEYWORD
    ]
    with pytest.raises(BadInputError) as refused:
        FUNCTIONS[name](**{each.name: object() for each in required})
    assert "\n" not in str(refused.value)


AIRCRAFT = Aircraft()
LEVEL = trim.level_flight(15 * DEGREE)
POINT = trim.find_operating_point(AIRCRAFT, LEVEL)
MODEL = trim.linearize(AIRCRAFT, POINT)
GAME = controller.published_game(MODEL)
NUMBERS = AIRCRAFT.parameters
CHECK = verification.judged_critic(MODEL).check


def _level_flights(**changes: Any) -> Any:
    points = trim.level_conditions(("dihedral",), np.array([[0.1], [0.2]]))
    asked = {"variant": AIRCRAFT.variant, "parameters": NUMBERS, "conditions": points} | changes
    return trim.solve_level_flights(**asked)  # type: ignore[arg-type]


@pytest.mark.parametrize(
    ("call", "said"),
    [
        (
            lambda: Aircraft("newton"),
            "Aircraft: parameters is 'newton'; .* Parameters or None.*give it as dynamics",
        ),
        (lambda: Aircraft(dynamics=None), "dynamics is None; it must be: text or Variant"),
        (lambda: trim.find_operating_point(AIRCRAFT, 15), "condition is 15; .*TrimCondition .made by level_flight"),
        (lambda: trim.find_operating_point(LEVEL, AIRCRAFT), "aircraft is a TrimCondition; .*give it as condition"),
        (lambda: trim.level_flight("15"), "dihedral is '15'; give a finite number"),
        (lambda: trim.level_flight(15), "dihedral is 859.437 deg; it must lie between"),
        (lambda: trim.linearize(AIRCRAFT, LEVEL), "point is a TrimCondition; it must be: OperatingPoint"),
        (lambda: trim.trim_report(AIRCRAFT, POINT, LEVEL), "condition is an OperatingPoint; .*give it as point"),
        (lambda: trim.entry_bands(AIRCRAFT, LEVEL, MODEL), "parameters is an Aircraft; it must be: ParameterSet"),
        (lambda: trim.modes_of(np.zeros((2, 3)), ("a", "b")), r"A is an array of shape \(2, 3\): .*square"),
        (lambda: controller.learn(MODEL), "game is a LinearModel; it must be: Game .made by"),
        (lambda: controller.learn(GAME, seed=-1), "seed is -1: expected non-negative"),
        (lambda: controller.Scenario(duration="1"), "duration is '1'; it must be a positive number"),
        (
            lambda: verification.check_critic(GAME, GAME),
            "candidate is a Game; .* Candidate .made by from_gain",
        ),
        (lambda: verification.loop_margins(GAME, np.zeros((2, 3))), "K is 2 x 3; .* it must be 5 x 6"),
        (lambda: verification.certified_schedule(AIRCRAFT, [0.1, 0.2]), "dihedrals is a list; it must be: array"),
        (lambda: verification.simulate(GAME, 1.0, 2.0, np.zeros(6), np.arange(3.0)), "control is 1.0; .*Feedback"),
        (lambda: verification.regenerate_all("published"), "aircraft is 'published'; it must be: Aircraft"),
        (lambda: Aircraft(15.0), "Aircraft: parameters is 15.0; it must be: Parameters or None"),
        (lambda: Aircraft(NUMBERS._replace(chord="8")), "parameter chord is '8'; give a finite number"),
        (lambda: AIRCRAFT.rates("x", POINT.inputs), "state is 'x'; give numbers"),
        (lambda: trim.level_flight(0.1, limits={"alpha": 0.2}), "limits of alpha is 0.2; give two numbers"),
        (lambda: trim.release(LEVEL, hold={"throttle": None}), "throttle is None; give a finite number"),
        (lambda: trim.sweep(AIRCRAFT, {"dihedral": 0.1}), "the values of dihedral are 0.1; give a list of numbers"),
        (lambda: trim.sweep(AIRCRAFT, {"dihedral": ["a"]}), "the values of dihedral are .'a'.; give a list of numbers"),
        (lambda: trim.SweepPlan({"dihedral": 0.1}, NUMBERS, "published"), "the values of dihedral are 0.1"),
        (lambda: trim.level_conditions(("dihedrl",), np.zeros((2, 1))), "unknown variable 'dihedrl'"),
        (lambda: trim.track_modes(np.zeros((2, 1, 1)), ("dihedrl",)), "unknown state 'dihedrl'; choose from speed"),
        (lambda: _level_flights(limits={"alfa": (0.0, 1.0)}), "unknown variable with limits 'alfa'"),
        (lambda: _level_flights(parameters=3.0), r"parameters are \(\); they must be \(18,\)"),
        (lambda: _level_flights(conditions=np.zeros((2, 1))), r"conditions are \(2, 1\); they must be \(N, 5\)"),
        (lambda: hfa_model.density(math.nan), "altitude is nan ft; the atmosphere covers 0 to"),
        (lambda: controller.published_game(MODEL, delt=100.0), "a game has no 'delt'; choose from Q, R, delta, E"),
        (
            lambda: controller.published_game(MODEL, delta=MODEL),
            "delta is Linear model .*; it must be a positive",
        ),
        (lambda: controller.Scenario(gust=3.0), "Scenario: gust is 3.0; it must be: Gust or None"),
        (lambda: controller.Scenario(reference=np.zeros(6)), r"reference is an array of shape \(6,\)"),
        (lambda: controller.Uncertainty(errors={"chord": "1"}), "the standard deviation of chord is '1'"),
        (lambda: controller.flight_envelope(NUMBERS, POINT, {"alpha": 0.1}), "the envelope of alpha is 0.1; give two"),
        (
            lambda: controller.Design("mine", actuators={"throttle": 2.0}),
            "actuator of throttle is 2.0; give an Actuator",
        ),
        (lambda: controller.MonteCarlo(math.nan, 0, NUMBERS, "published", *(POINT,) * 5), "members is nan"),
        (lambda: verification.judged_critic(GAME), "JudgedCritic: model is a Game; it must be: LinearModel"),
        (lambda: verification.Candidate(GAME.A.tolist(), None, "quadratic"), "K is a list; it must be: array"),
        (lambda: verification.solve_game(MODEL.to_control()), "game is a StateSpace; it must be: Game [(]made by"),
        (lambda: verification.bounded_real_gain(GAME, 1j * GAME.B.T), "K does not consist of rows of real numbers"),
        (lambda: verification.disk_margin(GAME, GAME.B), "K is 6 x 5; .* it must be 5 x 6: give its transpose"),
        (lambda: verification.check_report(CHECK, ("one",)), "1 names of states are given; the critic has 6"),
        (lambda: verification.check_critic(GAME, CHECK.candidate, limit=math.nan), "limit is nan; .* positive"),
        (lambda: verification.OutputGame(GAME, np.full((6, 6), math.nan), GAME.B, GAME.Q), "C.0..0. is nan"),
        (lambda: verification.certified_schedule(AIRCRAFT, np.zeros(0)), "a schedule needs at least two dihedrals"),
    ],
)
def test_the_argument_is_named_with_what_it_must_be(call: Callable[[], Any], said: str) -> None:
    with pytest.raises(BadInputError, match=said) as refused:
        call()
    assert "\n" not in str(refused.value)


def test_a_run_in_place_of_its_critic_is_said_where_it_belongs() -> None:
    run = controller.learn(GAME)
    with pytest.raises(BadInputError, match=r"candidate is a LearningResult; .*; give it as run"):
        verification.check_critic(GAME, run)  # type: ignore[arg-type]


def test_a_bug_of_our_own_stays_what_it_is() -> None:
    def broken(size: float) -> float:
        return size + None  # type: ignore[operator]

    with pytest.raises(TypeError, match="NoneType"):
        explained("broken", broken)(1.0)
    with pytest.raises(TypeError, match="missing 1 required"):
        explained("broken", broken)()


def test_what_works_with_an_argument_of_another_kind_goes_on_to_work() -> None:
    assert explained("half", _half)(np.float64(3.0)) == 1.5
    assert explained("half", _half)(math.pi) == math.pi / 2
    assert explained("half", _half)(True) == 0.5
    with pytest.raises(BadInputError, match="half: size is a list; it must be: number"):
        explained("half", _half)([1.0])


def _half(size: float) -> float:
    return size / 2


def test_a_function_is_one_and_travels_to_other_processes() -> None:
    assert trim.find_operating_point is trim.find_operating_point
    assert pickle.loads(pickle.dumps(trim.find_operating_point)) is trim.find_operating_point
    assert str(inspect.signature(trim.find_operating_point)).startswith("(aircraft: 'Aircraft', condition: ")


def test_a_module_that_was_loaded_before_the_door_opened_keeps_its_function() -> None:
    inside = inspect.unwrap(trim.find_operating_point)
    assert inside is not trim.find_operating_point
    assert pickle.loads(pickle.dumps(inside)) is inside


def test_lists_of_names_are_names_too() -> None:
    listed = trim.linearize(AIRCRAFT, POINT, outputs=["load_factor"], disturbances=["updraft"])  # type: ignore[arg-type]
    assert listed == trim.linearize(AIRCRAFT, POINT, outputs=("load_factor",), disturbances=("updraft",))
    assert listed.outputs == ("load_factor",)


def test_a_trim_of_other_dynamics_is_not_flown() -> None:
    newton, gain = Aircraft(dynamics="newton"), controller.gain_law("still", np.zeros((5, 6)))
    envelope, scenario = controller.flight_envelope(NUMBERS, POINT), controller.Scenario(duration=0.1)
    said = "the operating point was trimmed with 'published' dynamics, the aircraft has 'newton'"
    with pytest.raises(BadInputError, match=said):
        controller.fly(newton, POINT, gain, scenario, envelope)
    with pytest.raises(BadInputError, match=said):
        controller.MonteCarlo(1, 0, NUMBERS, "newton", POINT, "nonlinear", gain, scenario, envelope)


def test_what_came_through_a_door_is_made_as_before() -> None:
    point = trim.OperatingPoint(POINT.states, POINT.inputs, POINT.residuals, POINT.dynamics, POINT.status)
    assert point == POINT
    assert trim.LinearModel(MODEL.A, MODEL.B, list(MODEL.states), MODEL.inputs, point).A is MODEL.A  # type: ignore[arg-type]


@pytest.mark.parametrize("wrong", [np.ones(()), np.array(["one"]), "one", None])
def test_what_passed_once_lets_nothing_else_through(wrong: Any) -> None:
    @dataclass
    class Kept:
        values: np.ndarray
        scale: float

    explained_class(Kept)
    for right in (np.zeros(2), np.zeros(3)):
        assert Kept(right, scale=1.0).values is right
    with pytest.raises(BadInputError, match=r"Kept: values is .*; it must be: array"):
        Kept(wrong, scale=1.0)
    with pytest.raises(BadInputError, match=r"Kept: scale is .*; it must be: number"):
        Kept(np.zeros(2), scale="1")  # type: ignore[arg-type]
