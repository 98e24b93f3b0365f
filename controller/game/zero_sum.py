"""The zero-sum game on a linear model: who pays what, and the policies that a value gradient
implies."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_model.printed_matrices import published_data
from hfa_model.vectors import INPUTS, LINEAR_STATES
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown, shown
from hfa_support.reporting.fields import ByValue, Shown

if TYPE_CHECKING:
    from trim.linear.linear_model import LinearModel

#: Numbers beyond this (or below its inverse) overflow when they are multiplied, and mean nothing in
#: a model.
LARGEST = 1e100
#: Entries of a critic beyond this overflow when P S P is squared, and mean nothing.
LARGEST_CRITIC_ENTRY = 1e50


@dataclass(frozen=True, eq=False, repr=False)
class Game(ByValue, Shown):
    """J = ∫ z'Qz + u'Ru - δ² d'd dt,  z' = A z + B u + E d,  u minimizes and d maximizes (paper Eq.
    15-16).

    A: (n, n), B: (n, m), E: (n, k) disturbance matrix (the paper's is the identity), Q: (n, n)
    symmetric positive semidefinite, R: (m, m) symmetric positive definite, delta > 0 (may be inf:
    no disturbance, LQR). Raises BadInputError when a shape, a sign or a number is wrong."""

    A: np.ndarray
    B: np.ndarray
    E: np.ndarray
    Q: np.ndarray
    R: np.ndarray
    delta: float

    def __post_init__(self) -> None:
        """Check everything once, so that no solver has to."""
        for name in ("A", "B", "E", "Q", "R"):
            object.__setattr__(self, name, checked_matrix(name, getattr(self, name), LARGEST))
        n, m = len(self.A), self.B.shape[1]
        if 0 in (n, m):
            raise BadInputError("A or B is empty; a game needs a state and an input")
        shapes = {"A": (n, n), "B": (n, m), "E": (n, self.E.shape[1]), "Q": (n, n), "R": (m, m)}
        for name, shape in shapes.items():
            found = getattr(self, name).shape
            if found != shape:
                needed = (
                    "it must be square"
                    if name == "A"
                    else f"with this A and B it must be {shape_text(shape)}"
                )
                raise BadInputError(f"{name} is {shape_text(found)}; {needed}")
        check_definite("Q", self.Q, strictly=False)
        check_definite("R", self.R, strictly=True)
        object.__setattr__(self, "delta", _delta_of(self.delta))

    def __hash__(self) -> int:
        """Of a few numbers, the same for games that are equal: units of a game are kept."""
        return hash((float(self.A.sum()), float(self.B.sum()), self.delta))

    @cached_property
    def R_inverse_B_transposed(self) -> np.ndarray:
        """R⁻¹ B', (m, n)."""
        return np.linalg.solve(self.R, self.B.T)

    @cached_property
    def S_control(self) -> np.ndarray:
        """B R⁻¹ B', (n, n): what the control can do."""
        return self.B @ self.R_inverse_B_transposed

    @cached_property
    def S_disturbance(self) -> np.ndarray:
        """E E', (n, n): what the disturbance can do, before it is divided by δ²."""
        return self.E @ self.E.T

    @cached_property
    def S(self) -> np.ndarray:
        """S = B R⁻¹ B' - δ⁻² E E', (n, n): the quadratic term of the Riccati equation."""
        return self.S_control - self.S_disturbance / self.delta**2

    def gain(self, P: np.ndarray) -> np.ndarray:
        """K = R⁻¹ B' P, (m, n): the control policy of the value z'Pz is u = -K z."""
        return self.R_inverse_B_transposed @ P

    def checked_gain(self, K: np.ndarray) -> np.ndarray:
        """K as floats. BadInputError when it has another shape than B', or is complex."""
        K = numbers_in("K", K)
        n, m = self.B.shape
        if K.shape != (m, n):
            hint = ": give its transpose" if K.shape == (n, m) else ""
            raise BadInputError(
                f"K is {shape_text(K.shape)}; on a plant with {n} states and {m} inputs it must be {m} x {n}{hint}"
            )
        return K

    def disturbance_gain(self, P: np.ndarray) -> np.ndarray:
        """L = δ⁻² E' P, (k, n): the worst disturbance for the value z'Pz is d = L z."""
        return self.E.T @ P / self.delta**2

    def residual(self, P: np.ndarray) -> np.ndarray:
        """A'P + P A + Q - P S P, (n, n): zero at a solution of the game Riccati equation."""
        return self.A.T @ P + P @ self.A + self.Q - P @ self.S @ P

    def with_delta(self, delta: float) -> Game:
        """The same game at another disturbance weight; its matrices have been checked, and are not
        checked again."""
        shared = {name: value for name, value in vars(self).items() if name != "S"}
        return self.unchecked(**shared | {"delta": _delta_of(delta)})

    def unchecked(self, **parts: Any) -> Game:
        """A game with other parts that follow from those of this one, which is not checked
        again."""
        other = object.__new__(type(self))
        vars(other).update(
            {name: getattr(self, name) for name in ("A", "B", "E", "Q", "R", "delta")} | parts
        )
        return other


def published_game(
    A: LinearModel | np.ndarray, B: np.ndarray | None = None, **changes: Any
) -> Game:
    """The game of paper Section 5.1 on (A, B) or on a linear model: its Q, R, delta and E = I.

    `changes` replaces any of them. A linear model with more than the paper's six states has weight
    0 and no disturbance on the others; with anything else than six states and five inputs Q and R
    must be given."""
    states = getattr(A, "states", LINEAR_STATES)
    if B is None:
        model: Any = A
        if not hasattr(model, "B"):
            raise BadInputError("B is missing; give A and B, or a linear model")
        A, B = model.A, model.B
    for name in changes:
        refuse_unknown("a game has no", name, ("Q", "R", "delta", "E"))
    settings = published_data()["game"]
    A = checked_matrix("A", A, LARGEST)
    E, Q = np.eye(len(A)), np.diag(settings["Q_diag"]).astype(float)
    if len(states) > len(Q) and set(LINEAR_STATES) <= set(states):
        E = E[:, [states.index(name) for name in LINEAR_STATES]]
        Q = E @ Q @ E.T
    defaults = {
        "E": E,
        "Q": Q,
        "R": np.diag(settings["R_diag"]).astype(float),
        "delta": settings["delta"],
    }
    return Game(A=A, B=B, **(defaults | changes))


def usual_game(model: Model, A: np.ndarray, B: np.ndarray, **changes: Any) -> Game:
    """The game on (A, B) of a model; by default: the paper's if it has the HFA's states and inputs;
    else with 1/nominal² on the diagonals of Q and R, delta inf. `changes` replaces Q, R, delta."""
    if {*LINEAR_STATES} <= {*model.linear} and {*model.inputs} == {*INPUTS}:
        own: Any = SimpleNamespace(A=A, B=B, states=model.linear)
        return published_game(own, **changes)
    Q, R = (
        np.diag([model.signals[name].nominal ** -2.0 for name in names])
        for names in (model.linear, model.inputs)
    )
    usual: dict[str, Any] = {"E": np.eye(len(A)), "Q": Q, "R": R, "delta": np.inf}
    return Game(A, B, **(usual | changes))


def checked_matrix(name: str, value: Any, largest: float, ndim: int | None = 2) -> np.ndarray:
    """The value as a read-only array of floats. BadInputError where it is none, or a number not
    finite or too large."""
    array = numbers_in(name, value)
    if ndim not in (None, array.ndim):
        raise BadInputError(f"{name} has {array.ndim} dimension(s); it must have {ndim}")
    for bad in np.argwhere(~(np.abs(array) <= largest)):
        place, found = "".join(f"[{index}]" for index in bad), array[tuple(bad)]
        rule = (
            f"entries must not exceed {largest:g}"
            if np.isfinite(found)
            else "every entry must be finite"
        )
        raise BadInputError(f"{name}{place} is {found:g}; {rule}")
    array.setflags(write=False)
    return array


def _delta_of(delta: float) -> float:
    moderate = (
        isinstance(delta, (int, float, np.floating)) and LARGEST**-0.5 <= delta <= LARGEST**0.5
    )
    if not (moderate or delta == np.inf):
        few, many = LARGEST**-0.5, LARGEST**0.5
        said = f"it must be a positive number from {few:g} to {many:g}, or inf for a game without disturbance"
        raise BadInputError(f"delta is {shown(delta)}; {said}")
    return float(delta)


def check_definite(name: str, matrix: np.ndarray, *, strictly: bool) -> None:
    """BadInputError unless symmetric and positive semidefinite, or, strictly, definite by more than
    rounding.

    Definiteness is judged in units in which the diagonal is 1: weights of very different size are
    not singular."""
    scale = np.abs(matrix).max(initial=0.0)
    if np.abs(matrix - matrix.T).max(initial=0.0) > 1e-12 * scale:
        raise BadInputError(f"{name} is not symmetric; give a symmetric matrix")
    smallest = np.linalg.eigvalsh(matrix)[0]
    definite, kind, advice = (
        smallest >= -1e-12 * scale,
        "semidefinite",
        "make no eigenvalue negative",
    )
    if strictly:
        kind, advice, diagonal = "definite", "make every eigenvalue positive", np.diag(matrix)
        sizes = np.sqrt(np.maximum(diagonal, 1.0 / LARGEST))
        least = np.linalg.eigvalsh(matrix / sizes / sizes[:, None])[0]
        definite = (
            diagonal.min() >= 1.0 / LARGEST and least > 10 * len(matrix) * np.finfo(float).eps
        )
    if not definite:
        raise BadInputError(
            f"{name} is not positive {kind} (smallest eigenvalue {smallest:.3g}); {advice}"
        )


def shape_text(shape: tuple[int, ...]) -> str:
    """For a message: 5 x 6."""
    return " x ".join(map(str, shape))
