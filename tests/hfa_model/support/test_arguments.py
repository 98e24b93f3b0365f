"""An argument of the wrong kind is named in one line, at every door."""

from __future__ import annotations

import inspect
import math
import pickle
from collections.abc import Callable
from types import FunctionType
from typing import Any

import numpy as np
import pytest

import controller
import hfa_model
import trim
import verification
from hfa_model import DEGREE, Aircraft, BadInputError
from hfa_model.support.arguments import explained

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
        (lambda: trim.level_flight("15"), "level_flight: dihedral is '15'; it must be: number"),
        (lambda: trim.level_flight(15), "dihedral is 859.437 deg; it must lie between"),
        (lambda: trim.linearize(AIRCRAFT, LEVEL), "point is a TrimCondition; it must be: OperatingPoint"),
        (lambda: trim.trim_report(AIRCRAFT, POINT, LEVEL), "condition is an OperatingPoint; .*give it as point"),
        (lambda: trim.entry_bands(AIRCRAFT, LEVEL, MODEL), "parameters is an Aircraft; it must be: ParameterSet"),
        (lambda: trim.modes_of(np.zeros((2, 3)), ("a", "b")), r"A is an array of shape \(2, 3\): .*square"),
        (lambda: controller.learn(MODEL), "game is a LinearModel; it must be: Game .made by"),
        (lambda: controller.learn(GAME, seed=-1), "seed is -1: expected non-negative"),
        (lambda: controller.Scenario(duration="1"), "Scenario: duration is '1'; it must be: number"),
        (
            lambda: verification.check_critic(GAME, GAME),
            "candidate is a Game; .* Candidate .made by from_gain",
        ),
        (lambda: verification.loop_margins(GAME, np.zeros((2, 3))), r"K is an array of shape \(2, 3\): "),
        (lambda: verification.certified_schedule(AIRCRAFT, [0.1, 0.2]), "dihedrals is a list; it must be: array"),
        (lambda: verification.simulate(GAME, 1.0, 2.0, np.zeros(6), np.arange(3.0)), "control is 1.0; .*Feedback"),
        (lambda: verification.regenerate_all("published"), "aircraft is 'published'; it must be: Aircraft"),
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
