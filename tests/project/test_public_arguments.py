"""Arguments of another kind are refused by each public function and method."""

import inspect

import numpy as np
import pytest

import hfa

MODEL = hfa.aircraft()
GAME = hfa.Game(np.eye(2), np.eye(2), Q=np.eye(2), R=np.eye(2))
#: A point of the paper's aircraft.
POINT = (hfa.trim(MODEL).x, hfa.trim(MODEL).u)
#: Results of public functions, whose methods check their arguments too.
RESULTS = (MODEL, hfa.trim(MODEL), hfa.trim(MODEL).linearize(), GAME, hfa.solve(GAME))


class Other:
    """An object of no kind that a function accepts."""


def parameters():
    """Yield public functions, and methods of results, with each parameter that does not accept
    anything.
    """
    for owner, names in ((hfa, hfa), *((result, type(result)) for result in RESULTS)):
        for name in dir(names):
            if name.startswith("_") or not inspect.isfunction(getattr(names, name)):
                continue
            call = getattr(owner, name)
            for parameter, value in inspect.signature(call).parameters.items():
                if value.annotation != "Any" and (owner is hfa or value.kind != value.VAR_KEYWORD):
                    yield pytest.param(call, parameter, id=f"{call.__qualname__}-{parameter}")


@pytest.mark.parametrize(("call", "parameter"), parameters())
def test_an_argument_of_another_kind_is_refused_by_name(call, parameter):
    """Each public function, and each method of a result, refuses an object of another kind, with
    the name of the parameter.
    """
    refusal = f"^{call.__name__}: {parameter} is of type Other; give"
    with pytest.raises(hfa.BadInputError, match=refusal):
        call(**{parameter: Other()})


def flown_with(weights):
    """Fly the paper's aircraft with the matrices (Q, R) of a cost."""
    model = hfa.aircraft()
    return hfa.fly(model, hfa.trim(model), weights=weights)


@pytest.mark.parametrize(
    ("call", "advised"),
    [
        (lambda: hfa.trim("examples/f16.py:F16"), "hfa.load_model"),
        (lambda: hfa.trim(hfa.aircraft(), free=["throttle", 3]), "list of int; .* a list of texts"),
        (lambda: hfa.identify(hfa.aircraft(), [3], free=["mass"]), "record 1 .* a dictionary"),
        (lambda: hfa.trim(hfa.aircraft(), 7), r'hfa\.trim\(model, dihedral="7 deg"\)'),
        (lambda: hfa.linearize(hfa.aircraft(), dihedral=1), r"hfa\.trim\(model, dihedral="),
        (lambda: hfa.Scenario(sample=float("nan")), "sample is nan s"),
        (lambda: flown_with([1]), "give the two matrices Q, R"),
        (lambda: flown_with([np.eye(2), np.eye(5)]), "Q is 2 x 2; give 6 x 6"),
        (lambda: MODEL.rates_at([1.0], [1.0]), "x has shape"),
        (lambda: MODEL.outputs_at(*POINT, ["no such"]), "unknown output 'no such'"),
        (lambda: GAME.gain(np.eye(3)), "P is 3 x 3; give 2 x 2"),
    ],
)
def test_a_refusal_advises_what_to_give(call, advised):
    """A refusal names what is accepted: the public functions that return it, its kind, or its
    shape.
    """
    with pytest.raises(hfa.BadInputError, match=advised):
        call()
