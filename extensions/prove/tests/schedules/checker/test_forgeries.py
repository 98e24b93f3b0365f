"""Forged certificates with correct digests. None with a false claim is accepted.

The statement of a forgery is false by construction. Its witness is one that an attacker may try:
the witness of the true statement, a damaged or exaggerated one, or the prover's witness for another
statement.
"""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
from forged_certificates import (
    CLAIM,
    CONTROLLER,
    FLIGHT,
    Change,
    Content,
    array,
    forged,
    forgeries,
    not_symmetric,
    put,
    runs_of,
    several,
)
from proof_cases import (
    PROOFS,
    certificate,
    content,
    exact_loop,
    family,
    forge,
    game_at,
    model_of,
    of_the_other_trim,
)

from hfa import BadInputError, prove_solution
from hfa_prove import check_certificate, prove_schedule
from hfa_prove.fields import Malformed, Rejected


def assert_refused(made: Content, kind: str, path: Path) -> None:
    with pytest.raises((Rejected, BadInputError, Malformed)):
        check_certificate(forge(path, made), model=model_of(kind))


@pytest.mark.slow
@pytest.mark.parametrize("kind", PROOFS)
def test_no_forgery_is_accepted(kind: str, tmp_path: Path) -> None:
    """All of more than 2000 forgeries are refused."""
    assert len(forgeries()) > 2000
    for forgery in forgeries():
        if forgery[0] == kind:
            assert_refused(forged(*forgery), kind, tmp_path / "forged.json")


# Forgeries that an earlier checker accepted.


def _witness_of_the_other_trim(kind: str) -> Change:
    return lambda made: made.update(witness=of_the_other_trim(kind)["witness"])


def _bounds_of_the_other_trim(made: Content) -> None:
    """Insert the delta_min of the other trim, with its evidence, into this trim's certificate."""
    other = of_the_other_trim("one of two")
    made["statement"]["delta_min"] = other["statement"]["delta_min"]
    for name in ("value", "refused", "frequencies"):
        made["witness"].pop(name, None)
        if name in other["witness"]:
            made["witness"][name] = other["witness"][name]


def _of_another_angle(made: Content) -> None:
    """Replace the evidence for a loop without gains by boxes proved for the exact gains."""
    own = content(prove_schedule(family(), exact_loop(14.0, 14.125), 14.0, 14.125))
    made["witness"]["loop"] = own["witness"]["loop"]


KNOWN: dict[str, tuple[str, Change]] = {
    "states of the aircraft that decay by themselves": (
        "rate",
        several(
            put(array(np.zeros_like), *CONTROLLER, "D"),
            put((-100.0 * np.eye(6)).tolist(), *CONTROLLER, "M"),
            put(50.0, *CLAIM, "decay_rate"),
        ),
    ),
    "a rate without bound": ("rate", put(1e9, *CLAIM, "scheduled_rate")),
    "gains of the wrong sign": ("gtm", put(array(lambda D: -100.0 * D), *CONTROLLER, "D")),
    "a good gain refuted": ("rate", put(runs_of(1, 1), *CLAIM, "loop")),
    "actuators that do nothing": (
        "actuators",
        several(
            put([1e-6, 1e6], *CLAIM, "actuators", "bandwidth"),
            put(np.zeros((11, 5)).tolist(), *CLAIM, "actuators", "G"),
        ),
    ),
    "P that is not symmetric": ("plant", several(not_symmetric)),
    "boxes of another trim": ("two trims", _witness_of_the_other_trim("two trims")),
    "a game of another trim": ("one of two", _witness_of_the_other_trim("one of two")),
    "delta_min of another trim": ("one of two", _bounds_of_the_other_trim),
    "speed beyond its limits": ("rate", put([70.0, 80.0], *FLIGHT, "limits", "speed")),
    "Q with a negative eigenvalue": (
        "plant",
        put([[1e12, 0.0], [0.0, -0.2]], *CLAIM, "weights", "Q"),
    ),
    "boxes of other gains": (
        "rate",
        several(put(array(np.zeros_like), *CONTROLLER, "D"), _of_another_angle),
    ),
}


@pytest.mark.parametrize("name", KNOWN)
def test_a_known_forgery_is_refused(name: str, tmp_path: Path) -> None:
    """Forgeries that an earlier checker accepted are refused."""
    kind, change = KNOWN[name]
    made = copy.deepcopy(certificate(kind))
    change(made)
    assert_refused(made, kind, tmp_path / "forged.json")


def test_a_certificate_about_another_trim_is_accepted(tmp_path: Path) -> None:
    """A certificate about the second trim of a model is accepted, and its statement contains
    this trim.
    """
    for kind in ("two trims", "one of two"):
        path = forge(tmp_path / "other.json", of_the_other_trim(kind))
        verified = check_certificate(path, model=model_of(kind))
        flight = getattr(verified.statement, "flight", getattr(verified.statement, "plant", None))
        assert flight.trims[0].unknowns["x"] == pytest.approx(-np.sqrt(2.0))


# Forgeries with one wrong entry, and the message that names it.

LOOP = ("witness", "loop", 0)
NAMED: dict[str, tuple[str, Change, str]] = {
    "a negative multiplier": (
        "actuators",
        put(lambda X: [-X[0], *X[1:]], *LOOP, "pieces", 0, "X"),
        "a Lyapunov function or a multiplier is not proved positive",
    ),
    "a Lyapunov function that is not positive": (
        "actuators",
        put(array(np.negative), *LOOP, "pieces", 0, "H"),
        "a Lyapunov function or a multiplier is not proved positive",
    ),
    "a piece left out": (
        "actuators",
        put([2.0, 10.0], *LOOP, "pieces", 0, "bandwidth"),
        "the pieces do not cover 1.8 to 10: nothing is proved at 1.8 to 2",
    ),
    "H not symmetric": (
        "rate",
        put(lambda H: [[H[0][0], 2 * H[0][1] + 1.0, *H[0][2:]], *H[1:]], *LOOP, "H"),
        "H: not symmetric",
    ),
    "P of the motion not symmetric": (
        "rate",
        put(lambda P: P + 1.0, "witness", "motion", "P", 0, 0, 1),
        "P: not symmetric",
    ),
    "P of the motion not positive": (
        "rate",
        put(array(np.negative), "witness", "motion", "P"),
        "the Lyapunov function for the moving scheduling variable is not proved positive",
    ),
    "a rate of the statement": (
        "rate",
        put(lambda rate: 2.0 * rate, *CLAIM, "scheduled_rate"),
        "not proved positive definite",
    ),
    "a trim moved": (
        "rate",
        put(
            lambda numbers: [numbers[0], numbers[1] + 1e-3, *numbers[2:]], *LOOP, "trim", "throttle"
        ),
        "a root of the equations is not proved to exist",
    ),
    "a box across a breakpoint": (
        "rate",
        put([14.0, 14.02], *CONTROLLER, "breakpoints"),
        "the box crosses a breakpoint",
    ),
    "a missing entry": ("rate", put(None, *CLAIM, "modes"), "missing entry"),
    "not finite": ("plant", put(float("nan"), *CLAIM, "plant", "A", 0, 0), "invalid entry"),
    "rows of other lengths": ("plant", put([[1.0], [1.0, 2.0]], *CLAIM, "plant", "A"), "A"),
    "a trim stated twice": (
        "two trims",
        put(lambda trims: trims * 2, *FLIGHT, "trims"),
        "invalid entry: trims",
    ),
    "another kind": ("plant", put("schedule", "kind"), "flight"),
    "a retired kind": ("plant", put("models", "kind"), "kind"),
}


@pytest.mark.parametrize("name", NAMED)
def test_refusals_name_the_error(name: str, tmp_path: Path) -> None:
    """The refusal of a forgery names what is wrong."""
    kind, change, message = NAMED[name]
    made = copy.deepcopy(certificate(kind))
    change(made)
    with pytest.raises((Rejected, BadInputError), match=message):
        check_certificate(forge(tmp_path / "forged.json", made), model=model_of(kind))


def test_a_game_of_another_angle_is_refused(tmp_path: Path) -> None:
    """The solution at 14.6 deg is refused as evidence for a statement at 14.5 deg."""
    made = copy.deepcopy(certificate("solution"))
    made["witness"] = content(prove_solution(game_at(14.6), family(), 14.6))["witness"]
    assert_refused(made, "solution", tmp_path / "forged.json")
