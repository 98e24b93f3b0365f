"""Arguments of another kind are refused by each public function and method."""

import inspect
from pathlib import Path

import numpy as np
import pytest

import hfa
from hfa_support.public_arguments import checked

MODEL = hfa.aircraft()
GAME = hfa.Game(np.eye(2), np.eye(2), Q=np.eye(2), R=np.eye(2))
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


def function(**hints):
    """Return a checked function of the project whose one argument has an annotation."""
    (annotation,) = hints.values()

    def called(x):
        return x

    called.__annotations__ = {"x": annotation}
    called.__module__ = "hfa_support.public_arguments"
    return checked(called, lambda kind: "")


@pytest.mark.parametrize(
    ("annotation", "right", "wrong", "said"),
    [
        ("float", [1, np.float64(2.0), np.int64(1)], [True, "1", np.ones(1), None], "a number"),
        ("int", [1, np.int64(1)], [1.0, False, np.ones(1, int)], "a whole number"),
        ("bool", [True, np.bool_(False)], [1, None], "True or False"),
        ("str | None", ["a", None], [1, b"a"], "a text"),
        (
            "Sequence[str]",
            [["a"], (), np.array(["a"])],
            ["a", [1], 3, ("a", None)],
            "a list of texts",
        ),
        ("Iterable[Any]", [[1], (x for x in "a")], ["ab", 1], "a list"),
        ("Mapping[str, float]", [{"a": 1}], [[1], "a"], "a dictionary"),
        ("Callable[..., Any] | Path", [len, Path()], [1], "a function or a path"),
        ("ArrayLike", [[1, 2], 3.0, np.eye(2)], ["1", b"1", None], "an array"),
        ("np.ndarray", [[1.0]], [[1j], [[1], [1, 2]]], ""),
        ("Any", [1, None, "a"], [], ""),
    ],
)
def test_values_of_a_kind_are_accepted_and_others_refused(annotation, right, wrong, said):
    """Numbers are no truth values, arrays of one number no numbers, texts no lists; the refusal
    says what to give.
    """
    call = function(x=annotation)
    for value in right * 2:
        call(value)
    for value in wrong:
        with pytest.raises(
            hfa.BadInputError, match=f"called: x is of type .*; give {said}$" if said else "x"
        ):
            call(value)
