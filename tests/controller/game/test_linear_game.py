"""Games on linear models: names from the model, and weights by name."""

from dataclasses import replace

import numpy as np
import pytest
from own_models import GTM, trimmed

import hfa
from controller.game.linear_game import (
    disturbance_text,
    matrix_text,
    sizes_text,
    weights_line,
    weights_of_flights,
)
from hfa import BadInputError
from hfa_aircraft import in_si


@pytest.fixture(scope="module")
def linear():
    model = hfa.aircraft()
    return hfa.linearize(model, hfa.trim(model, hold={"dihedral": 0.2}))


@pytest.mark.parametrize("dynamics", ["published", "unsteady"])
@pytest.mark.parametrize("units", ["ft", "si"])
def test_the_default_game_of_the_papers_aircraft_is_that_of_the_paper(dynamics, units):
    """Q, R, delta and E are those of Section 5.1 in the units of the model, 0 for lagged states.

    Another delta can be given.
    """
    model = hfa.aircraft(dynamics=dynamics)
    feet = 1.0
    if units == "si":
        model, feet = in_si(model), 0.3048
    linear = hfa.linearize(model, hfa.trim(model))
    default = hfa.game(linear)
    factors = np.array([feet, 1.0, 1.0, 1.0, 1.0, 1.0])
    Q = np.array([1000.0, 1000.0, 0.01, 0.01, 1000.0, 0.01]) / factors**2
    assert default.Q.diagonal() == pytest.approx([*Q, *[0.0] * (len(linear.states) - 6)])
    assert default.R.diagonal().tolist() == [100.0, 400.0, 400.0, 400.0, 50.0]
    assert pytest.approx(np.eye(len(linear.states), 6) * factors) == default.E
    assert default.delta == 200.0
    assert hfa.game(linear, delta=np.inf).delta == np.inf


def test_an_aircraft_without_weights_has_no_game():
    """Q and R are asked for where neither the model nor the user states them."""
    for given in ({}, {"Q": np.ones(4)}):
        with pytest.raises(BadInputError, match=r"there is no [QR] of .*--sizes"):
            hfa.game(trimmed(GTM).linearize(), **given)


def test_sizes_are_weights_of_deviations_that_are_as_bad_as_one_another(linear):
    """Q and R are 1/size², 0 for a state without a size."""
    sizes = {"speed": 10.0, "alpha": 0.1} | dict.fromkeys(linear.inputs, 0.5)
    game = hfa.game(linear, sizes=sizes)
    assert np.diag(game.Q) == pytest.approx([0.01, 100.0, 0.0, 0.0, 0.0, 0.0])
    assert pytest.approx(4.0 * np.eye(5)) == game.R
    for wrong, words in (
        ({"throttle": 0.0}, "the size of throttle is 0"),
        ({"alpha": -0.1}, "the size of alpha is -0.1"),
        ({"alpha": "5 deg"}, "the size of alpha is '5 deg'"),
        ({"alfa": 1.0}, "unknown name 'alfa'; choose from speed, alpha"),
    ):
        with pytest.raises(BadInputError, match=words):
            hfa.game(linear, sizes=sizes | wrong)
    with pytest.raises(BadInputError, match="no weight for throttle, aileron_center"):
        hfa.game(linear, sizes={"speed": 1.0})
    with pytest.raises(BadInputError, match="give sizes, or Q and R"):
        hfa.game(linear, sizes=sizes, R=np.ones(5))


@pytest.mark.parametrize(
    ("weights", "words"),
    [
        ({"Q": {"sped": 1.0}}, "Q weights an unknown name 'sped'; did you mean speed"),
        ({"Q": {"speed": "1"}}, "the Q weight of speed is '1'; give a number"),
        ({"R": {"throttle": 1.0}}, "R has no weight for aileron_center"),
        ({"Q": np.eye(5)}, "Q is 5 x 5"),
        ({"Q": [1.0, "2"]}, "Q does not consist of rows of real numbers"),
    ],
)
def test_a_wrong_weight_is_named(linear, weights, words):
    """The message on an unknown name, a missing weight or a wrong shape names the faulty entry."""
    with pytest.raises(BadInputError, match=words):
        hfa.game(linear, **{"Q": np.ones(6), "R": np.ones(5)} | weights)


def test_weights_that_are_not_given_are_those_of_the_file(folder):
    """Each of Q, R and N is the given one, else that of the file; given Q and R have N = 0, unless it
    is given too. Without Q and R in the file, flights have 1/nominal².
    """
    plant = {"A": np.eye(2), "B": np.ones((2, 1))}
    np.savez("plant.npz", **plant, Q=np.diag([4.0, 1.0]), R=[[5.0]], N=[[0.1], [0.2]])
    linear = hfa.load_model("plant.npz")
    linear = hfa.linearize(linear, hfa.trim(linear))
    of_file = {"Q": np.diag([4.0, 1.0]), "R": np.array([[5.0]]), "N": np.array([[0.1], [0.2]])}
    other = {"Q": np.diag([2.0, 3.0]), "R": np.array([[6.0]]), "N": np.array([[0.3], [0.0]])}
    for keys in ("", "Q", "R", "N", "QR", "QN", "QRN"):
        game = hfa.game(linear, **{key: other[key] for key in keys})
        expected = of_file | ({"N": np.zeros((2, 1))} if {*"QR"} <= {*keys} else {})
        expected |= {key: other[key] for key in keys}
        for key, matrix in expected.items():
            np.testing.assert_allclose(getattr(game, key), matrix, err_msg=f"{key} of {keys}")
    kept = {"Q": None, "R": None}
    assert weights_of_flights(linear) == kept
    assert weights_of_flights(linear, R=other["R"]) == kept | {"R": other["R"]}
    gtm = trimmed(GTM).linearize()
    nominal = gtm.model.nominal(gtm.states)
    weights = weights_of_flights(gtm, R=np.ones(len(gtm.inputs)))
    np.testing.assert_allclose(np.diag(weights["Q"]), 1.0 / nominal**2)
    assert weights["R"].tolist() == [1.0] * len(gtm.inputs)


def test_a_game_as_text():
    """Q, R, delta, N and E as one line: diagonals, other matrices, and many entries by their range."""
    game = hfa.Game(np.eye(2), [[0.0], [1.0]], Q=[4.0, 0.25], R=[1.0], delta=3.0)
    weights = "Q diag(4, 0.25) ({}), R diag(1) ({}), delta 3 ({})"
    identity = "E identity (d acts on each state)"
    assert weights_line(game) == f"{weights.format(*['of the game'] * 3)}, {identity}"
    given = {"Q": "given", "R": "default", "delta": "of the file"}
    assert weights_line(game, given) == f"{weights.format(*given.values())}, {identity}"
    crossed = replace(game, N=[[0.5], [0.0]], E=[[0.0], [1.0]])
    assert weights_line(crossed).endswith("N [0.5; 0] (of the game), E [0; 1]")
    named = crossed.names._replace(disturbances=("gust",))
    assert disturbance_text(replace(crossed, names=named)) == "E gust"
    assert sizes_text(game) == "x1 0.5, x2 2, u1 1"
    assert sizes_text(replace(game, Q=np.diag([4.0, 0.0]))) == "x1 0.5, u1 1"
    assert matrix_text(np.array([[1.0, 0.0], [3.0, 2.0]])) == "[1 0; 3 2]"
    assert matrix_text(np.diag(np.arange(40.0))).startswith("diag(0, 1, 2")
    assert matrix_text(np.diag(np.arange(41.0))) == "diag of 41 entries from 0 to 40"
    assert matrix_text(np.arange(42.0).reshape(2, 21)) == "matrix of 42 entries from 0 to 41"
