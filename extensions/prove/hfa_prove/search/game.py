"""Enclosures of the solution of a game and of delta_min, and bounds on a critic's distances."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass, replace
from itertools import pairwise
from typing import Any

import numpy as np
from flint import acb, acb_mat, arb, arb_mat

from controller.critic.critic import Critic
from controller.game.zero_sum import Game
from controller.riccati.gare import unconfirmed_solution
from controller.riccati.normal_form import NormalForm
from controller.riccati.smallest_delta import DeltaMin, minimum_delta
from hfa_prove.check.game import (
    Solution,
    check_axis,
    check_gain,
    critic_distances,
    gain_matrix,
    hamiltonian_rows,
    lyapunov_operator,
    riccati_S,
    solution_on,
)
from hfa_prove.check.trims import Rejected, linear_model_on
from hfa_prove.enclosure.balls import doubles, lowest_sign, matrix, norm
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.results import GameProof
from hfa_prove.search.family import Family, TrimSearch
from hfa_prove.search.lines import bounds_of_modes, find_line
from hfa_prove.search.proof import Content, Proof
from hfa_prove.statements.flight import Flight, TrimBox
from hfa_prove.statements.game import GameStatement, Plant, PointTrim, SolutionBox, Weights
from hfa_support.arguments import checks_arguments, need
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.progress import Progress

#: Relative width of the bracket at which the bisection ends.
WIDTH = 1e-6
#: Relative distances from the value in doubles that are tried on each side.
_DISTANCES = (1e-7, 2e-7, 5e-7, 1e-6, 1e-5, 1e-4, 1e-3)
#: Largest number of Newton steps on balls, and the relative size of a step after which one more
#: step suffices. Near the solution each step doubles the number of correct digits.
_STEPS = 20
_SETTLED = 1e-18
#: Reach of a solution: factor on the last Newton step, plus a part of the norm of P that is far
#: below the precision of a statement and far above rounding.
_REACH = 4.0
_LEAST = 1e-28
#: Relative enlargement of a distance in the certificate.
_SHARP = 1e-6


def weights_of(game: Game) -> Weights:
    """Return the weights of a game in the form of a statement.

    Raises BadInputError for cross weights. Raises NoSolutionError unless Q >= 0 and R > 0. The test
    is exact.
    """
    game.refuse_cross_weights("a certificate of hfa prove")
    Q = (game.Q + game.Q.T) / 2
    R = (game.R + game.R.T) / 2
    if lowest_sign(Q) < 0:
        raise NoSolutionError(
            "Q has a negative eigenvalue in exact arithmetic; give Q >= 0, such as a diagonal "
            "matrix of weights"
        )
    if lowest_sign(R) <= 0:
        raise NoSolutionError(
            "R is not positive definite in exact arithmetic; give R > 0, such as a diagonal "
            "matrix of weights"
        )
    return Weights(Q, R, game.E, float(game.delta))


@dataclass(frozen=True, eq=False)
class ExactGame:
    """A game with enclosures of A and B.

    game: the game in double precision
    weights: weights of the game, in the form of a statement
    plant: plant of the game, in the form of a statement
    trim: enclosure of the trim, or None for a plant given by matrices
    doubles: A and B for the stored doubles
    wide: A and B for every number that rounds to the stored doubles
    """

    game: Game
    weights: Weights
    plant: Flight | Plant
    trim: PointTrim | None
    doubles: tuple[TaylorModel, TaylorModel]
    wide: tuple[TaylorModel, TaylorModel]

    @classmethod
    def of(
        cls, game: Game, family: Family | None = None, scheduling_value: float | None = None
    ) -> ExactGame:
        """Return a game with enclosures of its A and B.

        game: the game in double precision
        family: aircraft whose linear model has A and B, or None if the game's A and B are exact
        scheduling_value: scheduling value of the linear model, or None if `family` is None

        Raises NoSolutionError unless Q >= 0 and R > 0, or if no trim is found or proved.
        """
        weights = weights_of(game)
        if family is None or scheduling_value is None:
            matrices = (TaylorModel(matrix(game.A)), TaylorModel(matrix(game.B)))
            return cls(game, weights, Plant(game.A, game.B), None, matrices, matrices)
        search = TrimSearch(replace(family, spread={}), scheduling_value, scheduling_value)
        trim = search.point_trim(scheduling_value)
        stated = search.stated_trim(scheduling_value)
        flight = replace(search.flight, trims=(stated,))
        box = TrimBox(scheduling_value, scheduling_value, trim.center, trim.radii)
        wide_box = replace(box, radii=trim.wide_radii)
        linear = linear_model_on(flight, box, decimals=False)
        wide_linear = linear_model_on(flight, wide_box, decimals=True)
        return cls(
            game=game,
            weights=weights,
            plant=flight,
            trim=trim,
            doubles=(linear.A, linear.B),
            wide=(wide_linear.A, wide_linear.B),
        )

    def with_delta(self, delta: float) -> ExactGame:
        """Return the game with another disturbance weight delta."""
        weights = replace(self.weights, delta=delta)
        return replace(self, game=self.game.with_delta(delta), weights=weights)

    def solution(self, *, decimals: bool = False, lowest: int = 1) -> tuple[SolutionBox, Solution]:
        """Return a stated and a proved enclosure of the stabilizing solution P.

        decimals: whether to cover every number that rounds to the stored doubles
        lowest: sign that the lowest eigenvalue of P must have

        Raises NoSolutionError if the enclosure or the sign is not proved.
        """
        A, B = self.wide if decimals else self.doubles
        box = find_solution(self.game, self.weights, A, B)
        return box, solution_on(self.weights, A, B, box, lowest)

    def has_value(self) -> bool:
        """Return whether a stabilizing and positive definite solution is proved to exist."""
        try:
            self.solution()
        except (NoSolutionError, ArithmeticError):
            return False
        return True

    def why_no_value(self) -> SolutionBox | list[float] | None:
        """Return a proof that the game has no value, or None if no proof is found.

        The proof is a stabilizing solution with a negative eigenvalue, or frequencies (rad/s)
        between which the Hamiltonian matrix H has an eigenvalue on the imaginary axis.
        """
        try:
            return self.solution(lowest=-1)[0]
        except (NoSolutionError, ArithmeticError):
            pass
        frequencies = list(self._frequencies_of_both_signs())
        try:
            check_axis(self.weights, *self.doubles, frequencies)
        except Rejected:
            return None
        return frequencies

    def _frequencies_of_both_signs(self) -> Iterator[float]:
        """Yield one ω with det(j ω I - H) > 0 and one with det(j ω I - H) < 0, if they are found.

        H is the Hamiltonian matrix. Frequencies near the eigenvalues of H closest to the imaginary
        axis are tried.
        """
        values = np.linalg.eigvals(NormalForm.of(self.game).hamiltonian)
        nearest = np.argsort(np.abs(values.real))[:4]
        near = sorted(np.abs(values[nearest].imag).tolist())
        ends = [near[0] * 0.9, *near, near[-1] * 1.1]
        A, B = self.doubles
        S = riccati_S(self.weights, B).range()
        rows = hamiltonian_rows(A.range(), S, matrix(self.weights.Q))
        H = acb_mat(rows)
        identity = acb_mat(matrix(np.eye(len(rows))))
        signs = set()
        for frequency in (*ends, *((a + b) / 2 for a, b in pairwise(ends))):
            value = (identity * acb(0, arb(frequency)) - H).det().real
            if value > 0:
                sign = 1
            elif value < 0:
                sign = -1
            else:  # not decided
                continue
            if sign not in signs:
                signs.add(sign)
                yield frequency


def find_solution(game: Game, weights: Weights, A: TaylorModel, B: TaylorModel) -> SolutionBox:
    """Return an unproved enclosure of the stabilizing solution P of a game.

    P is computed by Newton's method from the solution by the Schur form.

    A, B: enclosures of the matrices of the game

    Raises NoSolutionError if no solution is found or A - S P is not proved Hurwitz.
    """
    form = NormalForm.of(game)
    units = form.units
    start = form.by_schur()
    if not np.isfinite(start).all():
        raise NoSolutionError(
            "no finite approximate solution of the Riccati equation was found, "
            "from which the proof can begin"
        )
    T = matrix(np.diag(units))
    A = T.inv() * A * T
    S = T.inv() * riccati_S(weights, B) * T.inv()
    Q = T * matrix(weights.Q) * T
    P = matrix((start + start.T) / 2)
    for _ in range(_STEPS):
        correction = _newton_step(A, S, Q, P)
        P = P - (correction + correction.transpose()).mid() * 0.5
        P = P.mid()
        if float(norm(correction.entries())) <= _SETTLED * float(norm(P.entries())):
            break
    remaining = norm(_newton_step(A, S, Q, P).entries()).upper()
    reach = arb(_REACH * float(remaining) + _LEAST * float(norm(P.entries())))
    proof = find_line(A - S * P)
    if proof is None or proof[0] != 0:
        raise NoSolutionError("A - S P is not proved Hurwitz")
    return SolutionBox(units, TaylorModel(P), reach, proof[1])


def _newton_step(A: TaylorModel, S: TaylorModel, Q: arb_mat, P: arb_mat) -> arb_mat:
    """Return L⁻¹ F(P) with F the Riccati residual and L(E) = (A - S P)'E + E (A - S P).

    Raises NoSolutionError if L is singular within rounding.
    """
    n = P.nrows()
    loop = A - S * P
    residual = (loop.transpose() * P + P * A + Q).range()
    try:
        inverse = lyapunov_operator(loop.center.mid()).inv()
    except ZeroDivisionError as error:
        raise NoSolutionError(
            "the equation of Newton's step for P is singular within rounding"
        ) from error
    return arb_mat(n, n, (inverse * arb_mat(n * n, 1, residual.entries())).entries())


@dataclass(frozen=True, eq=False)
class Bracket:
    """Proved bounds of delta_min, refused < delta_min <= value.

    value: a delta at which the game has a value
    refused: a delta at which the game has no value
    why: proof that the game has no value at `refused`
    """

    value: float
    refused: float
    why: SolutionBox | list[float]


def prove_delta_min(
    exact: ExactGame, in_doubles: DeltaMin, progress: Progress | None = None
) -> Bracket | None:
    """Return proved bounds of delta_min, or None if no bounds are proved.

    The bounds are narrowed to the relative width `WIDTH`, or as far as proofs are found. The values
    of delta for which the game has a value form an interval (delta_min, inf] (Basar and Bernhard,
    Theorem 4.11).

    exact: the game, whose own delta is not used
    in_doubles: delta_min in double precision, where the search begins
    progress: called with the current step, or None
    """
    if in_doubles.value <= 0.0:
        return None
    guess = math.sqrt(in_doubles.value * in_doubles.refused)
    bracket = _first_bracket(exact, guess, progress)
    while bracket is not None and bracket.value - bracket.refused > WIDTH * bracket.value:
        _report(progress, "narrowing delta_min")
        middle = math.sqrt(bracket.value * bracket.refused)
        game = exact.with_delta(middle)
        if game.has_value():
            bracket = replace(bracket, value=middle)
            continue
        why = game.why_no_value()
        if not why:
            break
        bracket = replace(bracket, refused=middle, why=why)
    return bracket


def _first_bracket(exact: ExactGame, middle: float, progress: Progress | None) -> Bracket | None:
    value = None
    for distance in _DISTANCES:
        _report(progress, "bounding delta_min from above")
        if exact.with_delta(middle * (1.0 + distance)).has_value():
            value = middle * (1.0 + distance)
            break
    if value is None:
        return None
    for distance in _DISTANCES:
        _report(progress, "bounding delta_min from below")
        refused = middle * (1.0 - distance)
        why = exact.with_delta(refused).why_no_value()
        if why is not None:
            return Bracket(value, refused, why)
    return None


def _report(progress: Progress | None, what: str) -> None:
    """Call the progress function, if there is one, with the current step."""
    if progress is not None:
        progress(0, 1, what)


@checks_arguments
def prove_solution(
    game: Game,
    family: Family | None = None,
    scheduling_value: float | None = None,
    progress: Progress | None = None,
) -> Proof:
    """Return a proof that encloses the stabilizing solution of a game.

    game: the game in double precision
    family: aircraft whose linear model has A and B, or None if the game's A and B are exact
    scheduling_value: scheduling value of this linear model, or None if `family` is None
    progress: called with the current step, or None

    The proof's `data` contains the printed P and `relative_radius`, the largest relative distance
    of the exact solution from the printed P (Frobenius norm). With a family, the radius also covers
    every number that rounds to the stored parameters. P > 0 and A - S P Hurwitz are always proved.
    The attribute `proved` is True if A - B K is also proved Hurwitz and delta is above the proved
    bounds of delta_min.

    Raises NoSolutionError if the game has no value or its solution cannot be enclosed.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [1.0], [1.0], delta=10.0)
    >>> hfa.prove_solution(game).proved
    True
    """
    need(game, Game, "prove_solution: game", "a game: hfa.game(linear, Q, R, delta)")
    _report(progress, "solving in doubles")
    P = unconfirmed_solution(game).P
    _report(progress, "enclosing the linear model")
    exact = ExactGame.of(game, family, scheduling_value)
    _report(progress, "enclosing the solution")
    box, solution = exact.solution(decimals=True)
    A, B = exact.wide
    K = doubles(gain_matrix(exact.weights, B).center * matrix(P))
    critic = {"K": K, "P": P}
    distances = {}
    for name, (_, most) in critic_distances(critic, solution).items():
        distances[name] = (0.0, float(most) * (1.0 + _SHARP))
    loop, loop_lines = bounds_of_modes(A - B * matrix(K))
    modes, mode_lines = bounds_of_modes(exact.doubles[0])
    bracket = prove_delta_min(exact, minimum_delta(game), progress)
    decimals = exact.trim is not None
    statement = GameStatement(exact.plant, exact.weights, decimals, critic, True, distances, loop)
    is_above = bracket is not None and game.delta > bracket.value
    proved = is_above and statement.hurwitz is True
    data: Content = {
        "schema": GameProof.schema,
        "statement": "solution",
        "proved": proved,
        "P": P,
        "relative_radius": distances["P"][1],
        "positive_definite": True,
        "worst_case_hurwitz": True,
        "closed_loop_hurwitz": statement.hurwitz,
        "delta": game.delta if math.isfinite(game.delta) else None,
        "delta_min_above": None if bracket is None else bracket.refused,
        "delta_min_at_most": None if bracket is None else bracket.value,
        "unstable_modes": modes[0] if modes[0] == modes[1] else None,
        "unstable_modes_between": list(modes),
    }
    if bracket is None or not proved:
        return Proof(statement, {}, data)
    statement = replace(statement, delta_min=(bracket.refused, bracket.value), modes=modes)
    value, _ = exact.with_delta(bracket.value).solution()
    witness = _trim_content(exact.trim) | {
        "solution": _solution_content(box),
        "loop": [vars(line) for line in loop_lines],
        "modes": [vars(line) for line in mode_lines],
        "value": _solution_content(value),
    }
    if isinstance(bracket.why, SolutionBox):
        witness["refused"] = _solution_content(bracket.why)
    else:
        witness["frequencies"] = bracket.why
    return Proof(statement, witness, data)


@checks_arguments
def prove_critic(
    game: Game,
    critic: Critic,
    family: Family | None = None,
    scheduling_value: float | None = None,
) -> Proof:
    """Return a proof of a critic's distance from the exact solution and of the modes of A - B K.

    game, family, scheduling_value: as for `prove_solution`
    critic: critic whose W, P or K are compared

    The attribute `proved` of the result is True if A - B K is proved Hurwitz.

    Raises BadInputError for a network. Raises NoSolutionError if the exact solution cannot be
    enclosed.

    >>> import hfa
    >>> game = hfa.Game([[1.0]], [[1.0]], [[1.0]], [1.0], [1.0], delta=10.0)
    >>> hfa.prove_critic(game, hfa.from_gain(game, [[2.4]])).proved
    True
    """
    need(game, Game, "prove_critic: game", "a game: hfa.game(linear, Q, R, delta)")
    need(critic, Critic, "prove_critic: critic", Critic._how_to_make)
    if critic.network:
        raise BadInputError(
            "the critic is a network, which a proof of a game does not support; give W, P or K"
        )
    exact = ExactGame.of(game, family, scheduling_value)
    box, solution = exact.solution()
    A, B = exact.doubles
    parts: dict[str, np.ndarray] = {"K": critic.K}
    if critic.P is not None:
        parts["P"] = critic.P
        if critic.feedback is not None:  # K follows from P
            parts["K"] = doubles(gain_matrix(exact.weights, B).center * matrix(critic.P))
    if critic.weights is not None:
        parts["W"] = critic.weights[:, None]
    bounds = {}
    for name, (least, most) in critic_distances(parts, solution).items():
        low = max(0.0, float(least) * (1.0 - _SHARP) - _LEAST)
        bounds[name] = (low, float(most) * (1.0 + _SHARP) + _LEAST)
    loop, lines = bounds_of_modes(A - B * matrix(parts["K"]))
    of_value = _is_gain_of_value(exact, parts)
    statement = GameStatement(exact.plant, exact.weights, False, parts, of_value, bounds, loop)
    witness = _trim_content(exact.trim) | {
        "solution": _solution_content(box),
        "loop": [vars(line) for line in lines],
    }
    data = {
        "schema": GameProof.schema,
        "statement": "critic",
        "proved": statement.hurwitz is True,
        "distances": {
            name: {"at_least": low, "at_most": high} for name, (low, high) in bounds.items()
        },
        "closed_loop_hurwitz": statement.hurwitz,
    }
    return Proof(statement, witness, data)


def _is_gain_of_value(exact: ExactGame, parts: dict[str, np.ndarray]) -> bool:
    """Return whether the checker proves K to be the gain of the critic's P and W.

    Return False for a critic that has only K.

    parts: name -> matrix of the critic
    """
    if len(parts) == 1:
        return False
    try:
        check_gain(exact.weights, exact.doubles[1], parts)
    except Rejected:
        return False
    return True


def _trim_content(trim: PointTrim | None) -> dict[str, Any]:
    """Return the entry `trim` of a witness, or {} if the trim is None.

    The entry is unknown -> [center, radius, wide radius].
    """
    if trim is None:
        return {}
    rows = {}
    for name, constant in trim.center.items():
        rows[name] = [constant.center, float(trim.radii[name]), float(trim.wide_radii[name])]
    return {"trim": rows}


def _solution_content(box: SolutionBox) -> Content:
    content: Content = {"units": box.units, "P": [box.P.center.tolist()]}
    return content | {"reach": float(box.reach), "H": box.line.H, "turn": box.line.turn}
