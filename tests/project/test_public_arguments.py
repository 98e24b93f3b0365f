"""Arguments of another kind are refused at the door of each public function."""

import inspect

import control
import numpy as np
import pytest

import controller
import hfa

FUNCTIONS = [name for name in dir(hfa) if inspect.isfunction(getattr(hfa, name))]


GAME = hfa.Game(np.eye(2), np.eye(2), Q=np.eye(2), R=np.eye(2))


#: A point of the paper's aircraft.
POINT = (hfa.trim(hfa.aircraft()).x, hfa.trim(hfa.aircraft()).u)


class Other:
    """An object of no kind that a function accepts."""


def parameters():
    """Yield every public function with each of its parameters that does not accept anything."""
    for name in FUNCTIONS:
        for parameter in inspect.signature(getattr(hfa, name)).parameters.values():
            if parameter.annotation != "Any":
                yield name, parameter.name


@pytest.mark.parametrize(("function", "parameter"), parameters())
def test_an_argument_of_another_kind_is_refused_by_name(function, parameter):
    """Every public function refuses an object of another kind, and names the parameter."""
    with pytest.raises(hfa.BadInputError, match=f"^{function}: {parameter} is of type Other; give"):
        getattr(hfa, function)(**{parameter: Other()})


def flown_with(weights):
    """Fly the paper's aircraft with a cost."""
    model = hfa.aircraft()
    return hfa.fly(model, hfa.trim(model), weights=weights)


@pytest.mark.parametrize(
    ("call", "advised"),
    [
        (lambda: hfa.trim("examples/f16.py:F16"), "hfa.load_model"),
        (lambda: hfa.verify(3, np.eye(2)), "hfa.game"),
        (lambda: hfa.game(control.tf([1], [1, 1])), "hfa.linearize"),
        (lambda: hfa.optimize(hfa.aircraft(), inputs="elevator"), "give a list"),
        (lambda: hfa.trim(hfa.aircraft(), free=["throttle", 3]), "list of int; .* a list of texts"),
        (lambda: hfa.game(hfa.aircraft().at(*POINT)), "of type Linearization; give a LinearModel"),
        (lambda: hfa.identify(hfa.aircraft(), 3, free=["mass"]), "give a path or a table"),
        (lambda: hfa.identify(hfa.aircraft(), [3], free=["mass"]), "record 1 .* a dictionary"),
        (lambda: hfa.Scenario(delay="1 s"), "Scenario: delay is of type str; give a number"),
        (lambda: hfa.Scenario(sample=float("nan")), "sample is nan s"),
        (lambda: hfa.TrimCondition(hfa.aircraft(), 3), "imposed is of type int; give a dict"),
        (lambda: flown_with([1]), "give the two matrices Q, R"),
        (lambda: flown_with([np.eye(2), np.eye(5)]), "Q is 2 x 2; give 6 x 6"),
        (lambda: hfa.margins(np.eye(2), np.eye(2)), "LinearModel"),
        (lambda: controller.random_pool(GAME, True, 1), "count is of type bool; give a whole"),
        (lambda: controller.random_pool(GAME, np.eye(2), 1), "count is of type ndarray"),
    ],
)
def test_the_refusal_names_the_functions_that_return_the_required_kind(call, advised):
    """A refusal names the public functions whose results are accepted."""
    with pytest.raises(hfa.BadInputError, match=advised):
        call()


def test_a_misspelled_name_gets_the_error_of_python():
    """A misspelled argument is not refused by the project."""
    with pytest.raises(TypeError, match="unexpected keyword argument 'gamee'"):
        hfa.solve(gamee=3)
