"""Games on linear models: names from the model, and weights by name."""

import json

import numpy as np
import pytest
from own_models import GTM, trimmed
from scipy.linalg import solve_continuous_are

import hfa
from controller.game.linear_game import weights_of_flights
from hfa import BadInputError, Model, Signal
from hfa.main import main
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


@pytest.mark.parametrize("is_stored_in_si", [True, False])
def test_a_solution_passes_in_other_units_of_its_aircraft(is_stored_in_si, tmp_path):
    """The solution of a game in ft, lbf and deg passes in SI units, and the reverse."""
    model = Model(
        "cart",
        {"speed": Signal("ft/s", nominal=3.0), "angle": Signal("deg", nominal=5.0)},
        {"push": Signal("lbf", nominal=20.0), "turn": Signal("deg", nominal=2.0)},
        lambda x, u, p, w: (
            {"speed": -x.speed + 0.3 * x.angle + u.push, "angle": x.speed - x.angle + u.turn},
            {},
        ),
    )
    games = [
        hfa.game(linear, **weights_of_flights(linear), delta=2.0)
        for linear in (hfa.linearize(each, hfa.trim(each)) for each in (model, in_si(model)))
    ]
    judging, solved = games if is_stored_in_si else games[::-1]
    path = tmp_path / "solution.json"
    hfa.solve(solved).save(path)
    assert judging.names.input_units != solved.names.input_units
    assert hfa.verify(judging, path).ok


def test_default_weights_are_those_of_the_plant_file(folder, capsys):
    """Without Q and R, the solution is SciPy's for Q, R and N of a plant file, in Python and with
    `--aircraft`. A game without the first input has the entries of R and N of the second.
    """
    A, B = np.array([[0.0, 1.0], [2.0, -0.3]]), np.array([[0.0, 0.5], [1.0, 0.0]])
    Q, R = np.array([[4.0, 0.5], [0.5, 1.0]]), np.array([[0.5, 0.1], [0.1, 2.0]])
    N = np.array([[0.1, 0.0], [0.0, 0.2]])
    np.savez("plant.npz", A=A, B=B, Q=Q, R=R, N=N)
    model = hfa.load_model("plant.npz")
    linear = hfa.linearize(model, hfa.trim(model))
    P = pytest.approx(solve_continuous_are(A, B, Q, R, s=N), rel=1e-9)
    assert hfa.solve(hfa.game(linear)).P == P
    assert main(["solve", "--aircraft", "plant.npz", "--json"]) == 0
    assert np.array(json.loads(capsys.readouterr().out)["P"]) == P
    for of_u2 in (hfa.game(linear.select(inputs=("u2",))), hfa.game(linear).select(("u2",))):
        assert (of_u2.R.tolist(), of_u2.N.tolist()) == ([[2.0]], [[0.0], [0.2]])


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
