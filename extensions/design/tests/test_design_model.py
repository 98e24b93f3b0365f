"""Designs in files and their design models.

Gains are compared with those of the independent program SimVFA, and matrices with finite
differences. Faulty designs are refused.
"""

from __future__ import annotations

import json
import math
import re
from collections import namedtuple
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import refusal
from known_models import model_at, released_simulation
from servo_cases import simvfa_design

import hfa
import hfa_model
from hfa import BadInputError, Game, Model, linearize, solve, trim
from hfa.paper import level_flight, published_game
from hfa_design import Actuator, Design, DesignModel, design_model, load_design
from hfa_model import LINEAR_STATES


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("inputs = 'throttle'", "inputs is 'throttle'; give a list"),
        ("weight = 3", "unknown entry weight; did you mean weights?"),
        (
            "[weights.inputs]\nthrottle = -1",
            "weights.inputs.throttle is -1; give a finite number of at least 0",
        ),
        (
            "[actuators]\nthrottle = 3",
            "actuators.throttle is 3; give a table [actuators.throttle]",
        ),
        (
            "[actuators.throttle]\neffectiveness = 0.0",
            "actuators.throttle: the effectiveness of an actuator is 0.0",
        ),
        ("[actuators.throttle]\norder = 3", "actuators.throttle: the order of an actuator is 3"),
        ("[disturbance]\nupdraft = 'x'", "disturbance.updraft is 'x'; give a finite number"),
        ("delta = -1", "delta is -1; give a number above 0"),
        ("delta = [", "is not a TOML file"),
    ],
)
def test_faulty_design_files_are_refused(tmp_path: Path, text: str, message: str) -> None:
    """A faulty entry of a design file is refused with its name and the correction."""
    path = tmp_path / "own.toml"
    path.write_text(text, encoding="utf-8")
    assert message in refusal(lambda name: load_design(name, hfa.aircraft()), path)


def test_an_unknown_design_is_refused() -> None:
    """A name that is not a design and not a readable file is refused with the list of designs."""
    with pytest.raises(
        BadInputError,
        match="no design and no readable file of this name; choose from paper, servo",
    ):
        load_design("nobody", hfa.aircraft())


#: Weights of a design without actuators and integrals.
BARE: dict = {"integrals": (), "state_weights": {}}
PEER = json.loads((Path(__file__).parent / "peer_gains.json").read_text(encoding="utf-8"))["gains"]


def design_at(aircraft: Model, design: Design, degrees: float) -> DesignModel:
    return design_model(aircraft, model_at(degrees, hfa_model.variant_of(aircraft).name), design)


@pytest.mark.parametrize("degrees", ["0", "5", "11", "20"])
def test_density_of_simvfa_gives_six_equal_digits(degrees: str) -> None:
    """At the altitude with SimVFA's air density, gains agree with SimVFA in all six stored digits.

    At 40,000 ft, some digits differ.
    """
    own, in_its_air = released_simulation()
    for altitude, digits in ((in_its_air, True), (40_000.0, False)):
        point = trim(own, level_flight(math.radians(float(degrees)), altitude=altitude))
        model = linearize(own, point)
        for name, tables in PEER.items():
            theirs = np.array(tables[degrees])
            half_units = 0.5 * 10.0 ** (np.floor(np.log10(np.abs(theirs))) - 5.0)
            ours = solve(design_model(own, model, simvfa_design(name)).game()).K
            assert (np.abs(ours - theirs) <= half_units).all() == digits


def test_the_paper_design_equals_the_papers_game(published_aircraft: Model, game: Game) -> None:
    """The game of the design `paper` has the matrices and delta of the paper's game."""
    built = design_at(published_aircraft, load_design("paper", hfa.aircraft()), 15.0).game()
    for name in ("A", "B", "E", "Q", "R"):
        np.testing.assert_array_equal(getattr(built, name), getattr(game, name))
    assert built.delta == game.delta
    assert published_game(game.A, game.B).delta == 200.0


def _gust_by_differences(aircraft: Model, built: DesignModel) -> np.ndarray:
    """Return the rates of states and integrals per ft/s of updraft, by finite differences.

    The differences are those of the nonlinear equations.
    """
    point = built.model.point
    h = 1e-4
    names = tuple(aircraft.disturbances)
    winds = namedtuple("winds", names)
    parameters = hfa_model.parameters_of(aircraft)
    sides = []
    for size in (h, -h):
        rising = winds(*(size if name == "updraft" else 0.0 for name in names))
        rates, outputs = aircraft.equations(point.states, point.inputs, parameters, rising)
        sides.append(
            {**point.states._asdict(), **outputs, **{f"{k}'": v for k, v in rates.items()}}
        )
    up, down = sides
    plain = [built.design.model.part(name)[0] for name in built.design.integrals]
    watched = [*(f"{name}'" for name in LINEAR_STATES), *plain]
    slopes = [float(up[name] - down[name]) / (2 * h) for name in watched]
    states, integrals = slopes[: len(LINEAR_STATES)], slopes[len(LINEAR_STATES) :]
    return np.array([*states, 0.0, 0.0, *integrals])


@pytest.mark.parametrize("dynamics", ["published", "newton"])
def test_updraft_columns_agree_with_finite_differences(dynamics: str) -> None:
    """The column of E for an updraft agrees with finite differences, including the rows of
    integrals.
    """
    aircraft = hfa.aircraft(dynamics)
    built = design_at(
        aircraft, replace(simvfa_design("simvfa-1"), disturbances={"updraft": 1.0}), 11.0
    )
    found = _gust_by_differences(aircraft, built)
    np.testing.assert_allclose(built.E[:, 0], found, rtol=1e-6, atol=1e-9)
    without = np.append(built.E[:-1, 0], 0.0)
    assert not np.allclose(without, found, rtol=1e-6, atol=1e-9)


def test_a_command_disturbance_enters_through_b(published_aircraft: Model) -> None:
    """A disturbance of the commands enters through the columns of B, scaled by the root of its
    intensity.
    """
    design = replace(simvfa_design("simvfa-1"), disturbances={"commands": 4.0, "states": 1e-6})
    built = design_at(published_aircraft, design, 11.0)
    np.testing.assert_array_equal(built.E[:, :2], 2.0 * built.B)
    np.testing.assert_array_equal(built.game().E, built.E)
    at_once = replace(design, actuators={}, sensors={"load_factor": 1.0}, **BARE)
    with pytest.raises(BadInputError, match="sensor load_factor depends directly on the commands"):
        design_at(published_aircraft, at_once, 11.0)


def test_a_mode_that_the_inputs_do_not_move_is_named_with_the_inputs_that_do() -> None:
    """x' = x + b moves by b alone: a design with the input a is refused."""
    model = Model(
        "two",
        {"x": hfa.Signal("m"), "y": hfa.Signal("m")},
        {"a": hfa.Signal("N"), "b": hfa.Signal("N")},
        lambda x, u, p, w: ({"x": x.x + u.b, "y": u.a - x.y}, {}),
        trim={"x": 0.0, "y": 0.0},
    )
    linear = linearize(model, trim(model))
    design = Design("own", inputs=("a",), input_weights={"a": 1.0}, model=model)
    with pytest.raises(hfa.NoSolutionError, match=r"do not move the mode x, .*; add b"):
        design_model(model, linear, design)


def test_integrals_the_inputs_cannot_change_are_refused(published_aircraft: Model) -> None:
    """Integrated outputs whose steady values the inputs cannot change independently are refused."""
    one = replace(
        simvfa_design("simvfa-1"),
        actuators={},
        inputs=("elevator_center",),
        input_weights={"elevator_center": 1.0},
        **BARE,
    )
    with pytest.raises(
        BadInputError,
        match="gamma: no input changes the steady-state value independently of dihedral",
    ):
        design_at(published_aircraft, replace(one, integrals=("dihedral", "gamma")), 11.0).game()


@pytest.mark.parametrize("order", [1, 2])
def test_an_actuator_follows_its_command(published_aircraft: Model, order: int) -> None:
    """An actuator has the specified poles and steady gain, and drives the aircraft through its
    column of B.
    """
    weak = Actuator(order=order, bandwidth=0.5, damping=0.9, effectiveness=0.2)
    design = Design(
        "own",
        ("throttle",),
        {"throttle": weak},
        input_weights={"throttle": 1.0},
        model=hfa.aircraft(),
    )
    assert design.disturbances == {"states": 1.0}
    built = design_at(published_aircraft, design, 5.0)
    rows = slice(6, None)
    rest = -np.linalg.solve(built.A[rows, rows], built.B[rows])
    assert rest[0, 0] == pytest.approx(0.2)
    poles = np.linalg.eigvals(built.A[rows, rows])
    assert np.abs(poles) == pytest.approx(np.full(order, 0.5))
    assert built.A[0, 6] == pytest.approx(built.model.B[0, 0])


def own(**changes: Any) -> Design:
    return replace(simvfa_design("simvfa-1"), **changes)


@pytest.mark.parametrize(
    ("make", "message"),
    [
        (lambda: own(inputs=("flaps",)), "design simvfa-1: unknown input 'flaps'"),
        (
            lambda: own(integrals=("dihedral", "dihedral")),
            "integrated output dihedral is named twice",
        ),
        (lambda: own(input_weights={}), "input aileron_outer has no weight"),
        (
            lambda: own(disturbances={"wind": 1.0}),
            "unknown disturbance 'wind'; did you mean headwind, headwind_center or",
        ),
        (
            lambda: own(disturbances={"updraft": 0.0}),
            "the intensity of disturbance updraft is 0.0; give a positive number",
        ),
        (lambda: Actuator(order=3), "the order of an actuator is 3; give 1 or 2"),
        (
            lambda: Actuator(damping=math.nan),
            "the damping of an actuator is nan; give a positive number",
        ),
    ],
)
def test_unusable_designs_are_refused(make: Callable[[], object], message: str) -> None:
    """Unknown names, missing weights and wrong numbers in a design are refused."""
    with pytest.raises(BadInputError, match=re.escape(message)):
        make()
