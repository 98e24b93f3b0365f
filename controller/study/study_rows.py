"""The rows of the study of the paper's update law: which settings are run, and why they end as they do."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import product
from typing import Any, NamedTuple

#: z(0) = x(0) - x_d(0) of Section 5.1: the flight that gives the current sample starts here.
FLIGHT_START = (-2.0, -0.05, 0.0, 0.0, -0.5, 0.0)
#: Relative changes of W(0) after which a run should end where it ended; if not, its end is an accident of rounding.
NEARBY = (-1e-9, 1e-9)


class StudyCase(NamedTuple):
    """changes: of `PublishedSettings`. seed: of the stack. from_lqr: weights set to the stabilizing start.

    box: the stack is drawn from `FLIGHT_BOX` instead of `recording.natural_spread`. nearby: relative changes of W(0)
    with which the run is made again.
    """

    changes: dict[str, Any]
    seed: int = 0
    from_lqr: tuple[str, ...] = ()
    box: bool = False
    nearby: tuple[float, ...] = ()


@dataclass(frozen=True)
class _Row:
    cases: Callable[[], Iterator[StudyCase]]
    cause: str


_COORDINATES, _NORMALISATIONS, _POLICIES = ("raw", "scaled"), ("root", "squared"), ("frozen", "reevaluated")


def _grid(bases: tuple[str, ...], **fixed: Any) -> Iterator[StudyCase]:
    for name, coordinates, kind, policies in product(bases, _COORDINATES, _NORMALISATIONS, _POLICIES):
        choice = {"basis": name, "coordinates": coordinates, "normalisation": kind, "stack_policies": policies}
        yield StudyCase(choice | fixed)


def _by_hand(coordinates: str, basis: str) -> Iterator[StudyCase]:
    for gain in (1.0, 10.0, 100.0, 1e3, 1e4):
        flight = {"coordinates": coordinates, "basis": basis, "flight_start": FLIGHT_START}
        yield StudyCase(flight | {"gains": (gain, gain)})


def _by_hand_from_lqr() -> Iterator[StudyCase]:
    for policies, seed in product(_POLICIES, (0, 1)):
        flight = _SCALED | {"stack_policies": policies, "gains": (100.0, 100.0), "flight_start": FLIGHT_START}
        yield StudyCase(flight, seed, ("initial_weights", "recorded_weights"))


def _frozen_alone() -> Iterator[StudyCase]:
    for kind in _NORMALISATIONS:
        yield StudyCase(_SCALED | _IMPLICIT | {"normalisation": kind, "initial_weights": 0.0}, 0, ("recorded_weights",))


def _reevaluated_alone(box: bool) -> Iterator[StudyCase]:
    for kind, seed in product(_NORMALISATIONS, (0, 1, 2)):
        choice = _SCALED | _IMPLICIT | {"normalisation": kind, "stack_policies": "reevaluated"}
        yield StudyCase(choice, seed, ("initial_weights",), box)


_SCALED: dict[str, Any] = {"basis": "quadratic", "coordinates": "scaled"}
_IMPLICIT: dict[str, Any] = {"integrator": "proximal", "step": 0.01}

#: The rows of the table in order.
STUDY: dict[str, _Row] = {
    "theorem gains, explicit": _Row(
        lambda: _grid(("quadratic", "paper", "quadratic+linear"), flight_start=FLIGHT_START),
        "lambda_0 of a stack on this aircraft is tiny, so alpha1 and alpha2 of Theorem 1 are huge, and the step"
        " that explicit integration needs is far below the 1e-4 s of the paper.",
    ),
    "theorem gains, implicit": _Row(
        lambda: (
            one._replace(nearby=NEARBY) for one in _grid(("quadratic", "paper"), integrator="proximal", step=0.05)
        ),
        "The implicit step survives, but W(0) = 100 does not stabilize: frozen policies have no value, and"
        " re-evaluated ones end at a root of the Riccati equation that is not the stabilizing one, or by accident at"
        " it: where a run is decided by rounding, another start in the ninth digit of W(0) leads to another root.",
    ),
    "gains by hand, raw, W(0) = 100": _Row(
        lambda: _by_hand("raw", "paper"),
        "W(0) = 100 does not stabilize; on the 5 degree model it makes a pole of -7.6e4 rad/s that no explicit"
        " step of 1e-4 s survives, and the flight is lost before the critic has learned.",
    ),
    "gains by hand, scaled, W(0) = 100": _Row(
        lambda: _by_hand("scaled", "quadratic"),
        "As above; at 15 degrees scaling keeps some runs bounded and does not make them accurate.",
    ),
    "gains by hand, scaled, stabilizing W(0)": _Row(
        _by_hand_from_lqr,
        "A stabilizing start, scaling and gains by hand keep flight and weights bounded; gains that an explicit"
        " step survives do not move the directions of the small eigenvalues of Sigma within T_w.",
    ),
    "learning alone, frozen, implicit": _Row(
        _frozen_alone,
        "Settles within theta T_w / 2 as the proof of Theorem 1 gives, but at the value of the recorded policies,"
        " not of the game.",
    ),
    "learning alone, re-evaluated, implicit": _Row(
        lambda: _reevaluated_alone(box=False),
        "With a stabilizing start, policies re-evaluated, an implicit step and states sampled"
        " with the plant's stationary deviations, the law finds the game's value.",
    ),
    "learning alone, re-evaluated, implicit, poorer stack": _Row(
        lambda: _reevaluated_alone(box=True),
        "The same from states of an ordinary flight (rates as small as the angles): the ideal case of Theorem 1"
        " does not occur because the residual is quadratic in the weight error, and Sigma moves: the gains are"
        " made for the lambda_0 of the start.",
    ),
}
