"""One quick forgery for each clause of the checker that no other test covers."""

from __future__ import annotations

import copy
from collections.abc import Callable
from contextlib import nullcontext
from dataclasses import replace
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_mat, ctx
from forged_certificates import CLAIM, FLIGHT, Change, array, put, several
from proof_cases import certificate, content, forge, model_of, of_the_other_trim, two_trims

import hfa
from hfa import Game, prove_solution
from hfa_aircraft.model import Model, Signal
from hfa_prove import Family
from hfa_prove.certificate import read_statement
from hfa_prove.check import check_certificate
from hfa_prove.check.equilibrium import root_offsets
from hfa_prove.check.game import check_axis, check_gain, check_game, distance_bounds, solution_on
from hfa_prove.check.linear_loop import LoopBox, closed_loop
from hfa_prove.check.modes import check_motion, check_pieces, least_and_most
from hfa_prove.check.trims import (
    _check_limits,
    _holds_root,
    _root_offsets,
    check_branches,
    linear_model_on,
)
from hfa_prove.enclosure.balls import doubles, matrix
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Fields, Malformed, Rejected
from hfa_prove.statements.flight import Line, TrimBox, _read_limits, in_model_unit
from hfa_prove.statements.game import GameWitness, Plant, SolutionBox, Weights
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.schedule import (
    Controller,
    FixedActuators,
    Piece,
    UncertainActuators,
)

_NO_SOLUTION = "a root|eigenvalue|Hurwitz"


def _one(*parts: float) -> TaylorModel:
    return TaylorModel(*(arb_mat([[arb(part)]]) for part in parts))


def _distance_too_large(made: Any) -> None:
    """Claim a lower bound of a gain's distance from the exact gain that exceeds the distance."""
    _, most = made["statement"]["distances"]["K"]
    made["statement"]["distances"]["K"] = [1.5 * most, 2.0 * most]


def _distance_too_small(made: Any) -> None:
    least, _ = made["statement"]["distances"]["K"]
    made["statement"]["distances"]["K"] = [0.0, 0.5 * least]


def _delta_min(share: float) -> Callable[[Any], Any]:
    """Return a change that moves one end of the bracket of delta_min across delta_min.

    share: factor, below 1 on the upper end and above 1 on the lower end
    """
    return lambda ends: [ends[0], ends[1] * share] if share < 1.0 else [ends[0] * share, ends[1]]


def _faster(made: Any) -> None:
    """Claim stability with actuators of higher bandwidth, with the evidence for slower
    actuators.
    """
    made["statement"]["actuators"]["bandwidth"][1] = 1e6
    for box in made["witness"]["loop"]:
        box["pieces"][-1]["bandwidth"][1] = 1e6


def _slower(made: Any) -> None:
    made["statement"]["actuators"]["bandwidth"][0] = 1e-3
    for box in made["witness"]["loop"]:
        box["pieces"][0]["bandwidth"][0] = 1e-3


def _refused_with_a_value(made: Any) -> None:
    """Claim that delta_min exceeds a delta for which the game has a value.

    The evidence is the positive solution of the game at this delta.
    """
    _, high = made["statement"]["delta_min"]
    made["statement"]["delta_min"] = [high, made["statement"]["weights"]["delta"]]
    witness = made["witness"]
    del witness["frequencies"]
    witness |= {"refused": witness["value"], "value": witness["solution"]}


def _refused_by_the_other_solution(made: Any) -> None:
    """Claim that delta_min exceeds a delta for which the game has a value.

    The evidence is the negative solution. This solution does not stabilize.
    """
    _, high = made["statement"]["delta_min"]
    made["statement"]["delta_min"] = [high, made["statement"]["weights"]["delta"]]
    S = 1.0 - 1.0 / high**2
    other = {"units": [1.0], "P": [[[-(1.0 + np.sqrt(1.0 + S)) / S]]], "reach": 1e-9}
    witness = made["witness"]
    del witness["frequencies"]
    witness |= {
        "refused": other | {"H": [[-1.0]], "turn": [[1.0]]},
        "value": witness["solution"],
    }


def _only_a_gain(made: Any) -> None:
    """Claim that K is the gain of the critic's P or W, although the critic has neither P nor W."""
    for name in ("P", "W"):
        made["statement"]["critic"].pop(name, None)
        made["statement"]["distances"].pop(name, None)
    made["statement"]["gain_of_value"] = True


def _a_gain_of_other_weights(made: Any) -> None:
    """Claim that K is the gain of the critic's W, although it is the gain of other weights."""
    del made["statement"]["critic"]["P"]
    del made["statement"]["distances"]["P"]
    made["statement"]["gain_of_value"] = True


#: Name -> kind of certificate, change, and message of the clause that refuses it.
FORGED: dict[str, tuple[str, Change, str]] = {
    "an error of what is scheduled": ("two trims", put({"p": 0.01}, *FLIGHT, "spread"), "spread"),
    "a trim above a limit": (
        "two trims",
        put([-9.0, 1.0], *FLIGHT, "limits", "x"),
        "x is not proved to be",
    ),
    "a trim below a limit": (
        "two trims",
        put([1.7, 9.0], *FLIGHT, "limits", "x"),
        "x is not proved to be",
    ),
    "a distance too large": ("plant", _distance_too_large, "distance of K"),
    "a distance too small": ("plant", _distance_too_small, "distance of K"),
    "K that does not follow": ("plant", put(True, *CLAIM, "gain_of_value"), "K is not the gain"),
    "delta_min too large": (
        "scalar",
        put(_delta_min(1.0 - 1e-9), *CLAIM, "delta_min"),
        _NO_SOLUTION,
    ),
    "no value at a delta that has one": (
        "scalar",
        put(lambda ends: [0.25 * ends[0] + 0.75 * ends[1], ends[1]], *CLAIM, "delta_min"),
        "imaginary axis",
    ),
    "value below delta_min": (
        "scalar",
        put(lambda ends: [0.5 * ends[0], 0.9 * ends[0]], *CLAIM, "delta_min"),
        _NO_SOLUTION,
    ),
    "no value above delta_min": (
        "scalar",
        put(lambda ends: [1.1 * ends[1], 1.2 * ends[1]], *CLAIM, "delta_min"),
        _NO_SOLUTION,
    ),
    "a value at the refused delta": (
        "scalar",
        _refused_with_a_value,
        "the sign of the lowest eigenvalue",
    ),
    "a solution that does not stabilize": ("scalar", _refused_by_the_other_solution, "Hurwitz"),
    "modes of the loop without evidence": (
        "plant",
        put([], "witness", "loop"),
        "the boxes of loop .* do not cover",
    ),
    "modes of the plant without evidence": (
        "scalar",
        put([], "witness", "modes"),
        "the boxes of modes .* do not cover",
    ),
    "K that does not follow from W": ("plant", _a_gain_of_other_weights, "K is not the gain"),
    "a gain of no value": ("plant", _only_a_gain, "gain_of_value"),
    "a trim stated 1e-5 away": (
        "two trims",
        put(lambda x: x + 1e-5, *FLIGHT, "trims", 0, "unknowns", "x"),
        "a root",
    ),
    "other modes": ("scalar", put([1, 1], *CLAIM, "modes"), "modes"),
    "actuators too slow": ("actuators", _slower, "not proved positive definite"),
    "actuators too fast": ("actuators", _faster, "not proved positive definite"),
    "a decay that no box has": (
        "two trims",
        put(lambda rate: 1.01 * rate, *CLAIM, "decay_rate"),
        "do not cover",
    ),
    "another stated trim within a box": (
        "two trims",
        several(
            put(
                lambda trims: [*trims, trims[0] | {"breakpoint": 1.25}],
                *FLIGHT,
                "trims",
            )
        ),
        "branch",
    ),
}


FORGED |= {
    "an imposed value above its limit": (
        "two trims",
        put([-1.0, -0.5], *FLIGHT, "limits", "u"),
        "u beyond its limits",
    ),
    "an imposed value below its limit": (
        "two trims",
        put([0.5, 1.0], *FLIGHT, "limits", "u"),
        "u beyond its limits",
    ),
    "effectiveness that varies more": (
        "actuators",
        put([0.25, 1.25], *CLAIM, "actuators", "effectiveness"),
        "not proved positive definite",
    ),
    "a trim stated within the flights": (
        "two trims",
        put([{"breakpoint": 1.25, "unknowns": {"x": 1.5}}], *FLIGHT, "trims"),
        "below the first trim in the certificate",
    ),
    "fixed actuators that do little": (
        "memory",
        put(array(lambda share: 1e-6 * share), *CLAIM, "actuators", "effectiveness"),
        "not proved positive definite",
    ),
    "a longer delay": (
        "actuators",
        put(0.1, *CLAIM, "actuators", "delay"),
        "not proved positive definite",
    ),
}


@pytest.mark.parametrize("name", FORGED)
def test_each_clause_refuses_its_forgery(name: str, tmp_path: Any) -> None:
    """Each clause of the checker refuses the forgery that violates it."""
    kind, change, message = FORGED[name]
    made = copy.deepcopy(certificate(kind))
    change(made)
    with pytest.raises((Rejected, Malformed), match=message):
        check_certificate(forge(tmp_path / "forged.json", made), model=model_of(kind))


def test_more_equations_than_unknowns_have_no_trim() -> None:
    """A trim with more equations than unknowns is refused."""
    slopes = SimpleNamespace(slopes=[[_one(1.0)], [_one(1.0)]])
    with pytest.raises(Rejected, match=r"equations \(2\) and of unknowns \(1\) differ"):
        _root_offsets([_one(0.0), _one(0.0)], slopes, [arb(1)])


@pytest.mark.parametrize("load", [-2.0, 2.0])
def test_limits_of_outputs_are_checked(load: float) -> None:
    """A trim whose output is not proved to be within its limits is refused."""
    model = SimpleNamespace(schedule="p", outputs={"load": Signal()})
    flight = SimpleNamespace(model=model, imposed={}, limits={"load": (-1.0, 1.0)})
    _check_limits(flight, {"load": arb(0.5)})
    with pytest.raises(Rejected, match="load is not proved to be"):
        _check_limits(flight, {"load": arb(load)})


def test_an_equation_within_rounding_of_0_is_refused() -> None:
    """A trim equation 0 x = 0 needs no unknown. The equation 0 x = e with |e| <= 1e-60 is refused.

    The residual e may differ from 0.
    """
    slopes = SimpleNamespace(slopes=[[arb(1)], [arb(0)]])
    assert _root_offsets([arb(0), arb(0)], slopes, [arb(1)])[0].contains(0)
    with pytest.raises(Rejected, match=r"equations \(2\) and of unknowns \(1\) differ"):
        _root_offsets([arb(0), arb(0, 1e-60)], slopes, [arb(1)])


def test_distance_bounds_are_valid_in_the_whole_box() -> None:
    """The bounds of a distance contain its values in the whole box."""
    least, most = distance_bounds(_one(3.0, 0.5, 0.0, 0.0), None)
    assert least <= 2.5
    assert most >= 3.5
    assert distance_bounds(_one(0.0, 1.0), None)[0] <= 0


def test_both_signs_of_the_rate_are_checked() -> None:
    """A moving scheduling variable is refused if V increases for either sign of its rate.

    For x' = -x with P = 1 the decrease 2 exceeds a growth of 1, but not of ±3.
    """
    loop, P = _one(-1.0), _one(1.0)
    check_motion(loop, P, arb_mat([[1.0]]), np.eye(1))
    for growth in (3.0, -3.0):
        with pytest.raises(Rejected):
            check_motion(loop, P, arb_mat([[growth]]), np.eye(1))


def test_each_actuator_has_its_own_parameters() -> None:
    """The loop contains each actuator with its own order, damping, bandwidth and effectiveness.

    u = -x acts with effectiveness 0.9 through 2 / (s + 2), and v = -3 x with effectiveness 0.4
    through a second-order actuator of 5 rad/s.
    """
    signals = {name: Signal() for name in ("u", "v")}
    model = Model(
        "two", {"x": Signal()}, signals, lambda x, u, p, w: ({"x": u.u + u.v}, {}), trim={}
    )
    table = np.zeros((2, 0, 0))
    gains = np.array([[[-1.0], [-3.0]]] * 2)
    controller = Controller(
        breakpoints=np.array([0.0, 1.0]),
        inputs=("u", "v"),
        measurements=("x",),
        A=table,
        B=np.zeros((2, 0, 1)),
        C=np.zeros((2, 2, 0)),
        D=gains,
    )
    numbers = [np.array(pair) for pair in ([0.7, 0.3], [2.0, 5.0], [0.9, 0.4])]
    row = TaylorModel(arb_mat([[arb(7), arb(11)]]))
    linear = SimpleNamespace(trim=SimpleNamespace(low=0.0, high=1.0), A=_one(-0.5), B=row)
    found = closed_loop(linear, model, controller, FixedActuators((1, 2), *numbers))
    expected = [
        [-0.5, 7.0, 11.0, 0.0],
        [-2.0 * 0.9, -2.0, 0.0, 0.0],
        [0.0, 0.0, 0.0, 5.0],
        [-3.0 * 5.0 * 0.4, 0.0, -5.0, -2.0 * 0.3 * 5.0],
    ]
    np.testing.assert_allclose(doubles(found.range()), expected, rtol=1e-14)


def test_a_controller_with_states_is_closed_without_actuators() -> None:
    """The loop of x' = A x + B u and x_c' = A_c x_c + B_c y, u = C_c x_c + D_c y is assembled.

    The controller measures the second state of two, and its tables are linear in between.
    """
    model = Model(
        "two states",
        {"x": Signal(), "v": Signal()},
        {"u": Signal(), "w": Signal()},
        lambda x, u, p, w: ({"x": x.v, "v": u.u + u.w}, {}),
        trim={},
    )
    rng = np.random.default_rng(5)
    tables = [rng.normal(size=(2, *sides)) for sides in ((3, 3), (3, 1), (1, 3), (1, 1))]
    controller = Controller(
        breakpoints=np.array([1.0, 3.0]),
        inputs=("w",),
        measurements=("v",),
        **dict(zip("ABCD", tables, strict=True)),
    )
    A, B = rng.normal(size=(2, 2)), rng.normal(size=(2, 2))
    linear = SimpleNamespace(
        trim=SimpleNamespace(low=1.5, high=1.5),
        A=TaylorModel(matrix(A)),
        B=TaylorModel(matrix(B)),
    )
    found = closed_loop(linear, model, controller, None)
    A_c, B_c, C_c, D_c = (0.75 * first + 0.25 * last for first, last in tables)
    y = np.array([[0.0, 1.0]])
    b = B[:, 1:]
    expected = np.block([[A + b @ D_c @ y, b @ C_c], [B_c @ y, A_c]])
    np.testing.assert_allclose(doubles(found.range()), expected, rtol=1e-12)
    other = replace(controller, measurements=("w_position",))
    with pytest.raises(Rejected, match="is not a state"):
        closed_loop(linear, model, other, None)


def test_the_delay_acts_on_the_commands_that_arrive() -> None:
    """x' = -x(t - delay) is proved stable with a delay of 0.5 s and refused with 2 s."""
    zero, one = _one(0.0), _one(1.0)
    loop = LoopBox(zero, arb_mat([[0]]), arb_mat([[1]]), -one)
    for delay, X in ((0.5, [1.0, 10.0]), (2.0, [1e-3, 10.0])):
        ends = (1.0, 1.0)
        actuators = UncertainActuators((1,), np.ones(1), ends, ends, delay)
        piece = Piece(ends, np.eye(1), np.array(X), np.eye(3))
        if delay > 1.0:
            with pytest.raises(Rejected, match="not proved positive definite"):
                check_pieces(loop, actuators, [piece])
        else:
            check_pieces(loop, actuators, [piece])


def test_a_line_off_the_axis_bounds_one_side() -> None:
    """A line to the left or right of the imaginary axis gives only one bound on the unstable modes.

    For x' = -x, the line at -2 proves at most 1 such mode, and the line at +1 at least 0.
    """
    A = _one(-1.0)
    left = Line(np.array([[-1.0]]), np.eye(1), 2.0)
    right = Line(np.array([[1.0]]), np.eye(1), -1.0)
    assert least_and_most(A, left) == (0, 1)
    assert least_and_most(A, right) == (0, 1)


def test_a_root_must_be_within_its_radius() -> None:
    """The root of x - 1 is refused about 0 with a radius of 0.5, and proved with a radius of 2."""
    residual = arb_mat([[arb(-1)]])
    slope = arb_mat([[arb(1)]])
    with pytest.raises(Rejected, match="a root"):
        root_offsets(residual, slope, [arb(0.5)])
    root_offsets(residual, slope, [arb(2)])


def test_boxes_of_another_branch_are_refused() -> None:
    """Boxes of the trims -sqrt(1 + p) are refused for a branch stated at +sqrt(2)."""
    made = certificate("two trims")
    flight = read_statement(
        "schedule", copy.deepcopy(made["statement"]), Subject(two_trims())
    ).flight  # type: ignore[union-attr]
    models = []
    for box in of_the_other_trim("two trims")["witness"]["modes"]:
        entries = Fields("box", {"range": box["range"], "trim": box["trim"]})
        models.append(linear_model_on(flight, TrimBox.read(entries, flight)))
    with pytest.raises(Rejected, match="branch"):
        check_branches(flight, models)


@ctx.workprec(256)
def test_a_root_with_inexact_stated_value_is_enclosed() -> None:
    """A root of 0.75 p² + 2 p = 1 is enclosed if the stated root has an error of 0.1.

    The box around the stated root has the half-width 0.5. One Newton step would not suffice.
    """
    one = np.eye(1)
    root = (arb(1.75).sqrt() - 1) / arb(0.75)
    stated = TaylorModel(arb_mat([[root.mid() + arb(0.1)]]))
    box = SolutionBox(np.ones(1), stated, arb(0.5), Line(one, one))
    found = solution_on(Weights(one, one, one, 2.0), _one(-1.0), _one(1.0), box, lowest=1)
    assert found.P.range()[0, 0].contains(root)


def test_indefinite_weights_are_refused() -> None:
    """Weights with a negative entry of Q, or with R that is not positive definite, are refused."""
    good = {"Q": [[1.0]], "R": [[1.0]], "E": [[1.0]], "delta": 2.0}
    known = SimpleNamespace(plant=Plant(np.eye(1), np.eye(1)))
    Weights.read(Fields("weights", good), known)
    for name, value in (("Q", -1e-300), ("R", 0.0), ("R", -1.0)):
        with pytest.raises(Malformed, match=f"{name} is not positive"):
            Weights.read(Fields("weights", good | {name: [[value]]}), known)


def test_a_determinant_of_one_sign_proves_nothing() -> None:
    """Frequencies at which the determinant of H - jω has one sign do not prove an eigenvalue on the
    axis.

    For x' = -x + u without disturbance, H has no eigenvalue on the axis.
    """
    one = np.eye(1)
    weights = Weights(one, one, one, 1e6)
    with pytest.raises(Rejected, match="axis"):
        check_axis(weights, _one(-1.0), _one(1.0), [0.0, 1.0, 10.0])


def test_one_sided_limits_must_be_stated() -> None:
    """A statement without a limit of the model is refused, even if this limit has one side only."""
    model = SimpleNamespace(limits={"speed": (0.0, np.inf)}, disturbances={})
    known = SimpleNamespace(model=model)
    assert _read_limits(Fields("flight", {"limits": {"speed": [0.0, 9.0]}}), "limits", known)
    with pytest.raises(Malformed, match="speed"):
        _read_limits(Fields("flight", {"limits": {}}), "limits", known)


def test_a_root_is_proved_only_by_a_contraction() -> None:
    """A residual of 0 proves no root if the slope may have either sign: w² has a double root at 0."""
    none = arb_mat([[arb(0)]])
    with pytest.raises(Rejected, match="a root of the equations"):
        root_offsets(none, arb_mat([[arb(1, 2)]]), [arb(1)])
    assert root_offsets(none, arb_mat([[arb(1, 0.5)]]), [arb(1)])[0, 0].contains(arb(0))


def test_pairs_ascend() -> None:
    """A pair whose first number exceeds the second is refused."""
    assert Fields("", {"a": [1.0, 2.0]}).pair("a") == (1.0, 2.0)
    with pytest.raises(Malformed, match="a"):
        Fields("", {"a": [2.0, 1.0]}).pair("a")


def test_texts_are_among_those_allowed() -> None:
    """A list with a text that is not allowed is refused."""
    assert Fields("", {"a": ["x"]}).texts("a", ("x", "y")) == ("x",)
    with pytest.raises(Malformed, match="a"):
        Fields("", {"a": ["z"]}).texts("a", ("x", "y"))


def test_breakpoints_ascend() -> None:
    """Breakpoints that do not ascend strictly are refused."""
    assert Fields("", {"a": [1.0, 2.0]}).increasing("a").tolist() == [1.0, 2.0]
    for values in ([2.0, 1.0], [1.0, 1.0], [1.0]):
        with pytest.raises(Malformed, match="a"):
            Fields("", {"a": values}).increasing("a")


@ctx.workprec(256)
def test_degrees_are_enclosed_in_radians() -> None:
    """The enclosure of 180 deg in radians contains pi."""
    assert in_model_unit(hfa.aircraft("published"), arb(180)).contains(arb.pi())


def test_the_game_of_the_other_trim_is_refused() -> None:
    """Evidence for the trim -sqrt(2) is refused for a statement about the trim +sqrt(2)."""
    made = copy.deepcopy(of_the_other_trim("one of two"))
    flight = certificate("one of two")["statement"]["plant"]
    made["statement"]["plant"]["trims"] = flight["trims"]
    statement = read_statement("game", made["statement"], Subject(two_trims()))
    witness = GameWitness.read(Fields("witness", made["witness"]), statement)
    with pytest.raises(Rejected, match="branch"):
        check_game(statement, witness)


@ctx.workprec(256)
def test_loops_stable_for_doubles_only_are_refused() -> None:
    """A loop that is stable for the stored doubles only is refused if all decimals are claimed.

    Its pole -2 q sqrt(1 + p) - K is closer to 0 than the rounding of the double q.
    """
    model = replace(
        two_trims(),
        parameters={"p": Signal(nominal=57.0, start=1.0), "q": Signal(start=1.0)},
        equations=lambda x, u, p, w: ({"x": p.q * (1.0 + p.p - x.x * x.x) + u.u}, {}),
    )
    pole = -2.0 * arb(2).sqrt()
    one = np.eye(1)
    made = content(
        prove_solution(Game([[float(pole.mid())]], one, one, one, one, 20.0), Family(model), 1.0)
    )
    K = float(pole.mid())
    while not pole < arb(K):
        K = float(np.nextafter(K, np.inf))
    claim = made["statement"]
    claim |= {"critic": {"K": [[K]]}, "distances": {"K": [0.0, 100.0]}, "gain_of_value": False}
    for name in ("delta_min", "modes"):
        del claim[name]
    kept = {name: made["witness"][name] for name in ("trim", "solution")}
    line = {"H": [[1.0]], "turn": [[1.0]], "rate": 0.0}

    def check(*, decimals: bool) -> int:
        claim["decimals"] = decimals
        statement = read_statement("game", copy.deepcopy(claim), Subject(model))
        entries = Fields("witness", copy.deepcopy({**kept, "loop": [line]}))
        return check_game(statement, GameWitness.read(entries, statement))

    assert check(decimals=False) == 1
    with pytest.raises(Rejected, match="not proved positive definite"):
        check(decimals=True)


@pytest.mark.parametrize("size", [1e-6, 1.0, 1e6])
def test_gains_of_critics_are_checked_against_values(size: float) -> None:
    """K = R⁻¹ B'P with R = 4 and B = 2 is accepted within 1e-9, and refused for another P or W."""
    one = np.eye(1)
    weights = Weights(one, 4.0 * one, one, np.inf)
    B = TaylorModel(arb_mat([[2]]))
    for off, is_same in ((0.0, True), (5e-10, True), (2e-9, False), (-2e-9, False)):
        for part in ("P", "W"):
            critic = {"K": 0.5 * size * one, "P": size * one, "W": size * one}
            critic[part] = size * (1.0 + off) * one
            with nullcontext() if is_same else pytest.raises(Rejected, match="K is not the gain"):
                check_gain(weights, B, critic)


def test_trims_are_identified_for_all_parameter_errors() -> None:
    """Two trims are recognized as one trim only if they agree for all errors of the parameters.

    A trim 0.5 ± 0.3 is the only one within 1 of 0. A trim 0.5 ± 0.7 may be another.
    """

    def box_at(center: float, error: float) -> Any:
        polynomial = TaylorModel(arb(center), 0, 0, 0, arb(error))
        trim = TrimBox(1.0, 1.0, {"x": polynomial}, {"x": arb(1)})
        return SimpleNamespace(trim=trim, offsets={"x": arb(0)})

    assert _holds_root(box_at(0.0, 0.0), box_at(0.5, 0.3), 1.0)
    assert not _holds_root(box_at(0.0, 0.0), box_at(0.5, 0.7), 1.0)
