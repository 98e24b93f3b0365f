"""Statement of a certificate about the exact solution of a game, and its witness.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, arb_mat

from hfa_prove.enclosure.balls import lowest_sign
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Fields, Stated, Statement, Witness, entry, part, require
from hfa_prove.statements.flight import Flight, Line

#: Largest relative difference of a gain from the gain of a value (Frobenius norm).
SAME_GAIN = 1e-9


@dataclass(frozen=True, eq=False)
class Plant(Stated):
    """Plant x' = A x + B u + E w, given by its matrices.

    A: (n, n)
    B: (n, m)
    """

    A: np.ndarray = entry(lambda file, name, known: file.array(name, None, None), subject="plant")
    B: np.ndarray = entry(
        lambda file, name, known: file.array(name, len(known.A), None), subject="plant"
    )

    def check_consistent(self) -> None:
        """Raise Malformed unless A is square and B is not empty."""
        n = len(self.A)
        require(self.A.shape == (n, n) and self.B.size > 0, "A", self.A.shape)


def _read_plant(file: Fields, name: str, known: Any) -> Flight | Plant:
    """Return the plant of a game, given by its matrices or as an aircraft."""
    stated = file.fields(name)
    return (Plant if stated.has("A") else Flight).read(stated, known)


def _sides(known: Any) -> tuple[int, int]:
    """Return the numbers of states and inputs of a plant."""
    if isinstance(known.plant, Plant):
        n, m = known.plant.B.shape
        return n, m
    model = known.plant.model
    return len(model.linear), len(model.inputs)


@dataclass(frozen=True, eq=False)
class Weights(Stated):
    """Weights of the game with the cost ∫ x'Q x + u'R u - delta² w'w dt.

    Q: (n, n), symmetric, positive semidefinite
    R: (m, m), symmetric, positive definite
    E: (n, q), disturbance matrix
    delta: disturbance weight, inf without a disturbance

    The definiteness of Q and R is decided exactly.
    """

    Q: np.ndarray = entry(
        lambda file, name, known: file.symmetric(name, _sides(known)[0]), subject="weights"
    )
    R: np.ndarray = entry(
        lambda file, name, known: file.symmetric(name, _sides(known)[1]), subject="weights"
    )
    E: np.ndarray = entry(
        lambda file, name, known: file.array(name, _sides(known)[0], None), subject="weights"
    )
    delta: float = entry(
        lambda file, name, known: file.positive(name),
        store=lambda delta: "inf" if delta == math.inf else delta,
        subject="weights",
    )

    def check_consistent(self) -> None:
        """Raise Malformed unless Q is positive semidefinite and R positive definite."""
        require(lowest_sign(self.Q) >= 0, "weights: Q is not positive semidefinite")
        require(lowest_sign(self.R) > 0, "weights: R is not positive definite")


def _read_critic(file: Fields, name: str, known: Any) -> dict[str, np.ndarray]:
    stated = file.fields(name)
    n, m = _sides(known)
    critic = {"K": stated.array("K", m, n)}
    if stated.has("P"):
        critic["P"] = stated.array("P", n, n)
    if stated.has("W"):
        critic["W"] = stated.array("W", None, 1)
        require(len(critic["W"]) >= n * (n + 1) // 2, "W", len(critic["W"]))
    stated.close()
    return critic


def _read_distances(file: Fields, name: str, known: Any) -> dict[str, tuple[float, float]]:
    stated = file.fields(name)
    distances = {part_name: stated.pair(part_name, least=0.0) for part_name in known.critic}
    stated.close()
    return distances


def _read_bounds(file: Fields, name: str, known: Any) -> tuple[int, int] | None:
    """Return bounds of a number of eigenvalues, or None if the entry is missing."""
    if not file.has(name):
        return None
    low, high = file.pair(name, least=0)
    size = _sides(known)[0]
    require(low == int(low) and high == int(high) <= size, name, [low, high])
    return int(low), int(high)


def _read_delta_min(file: Fields, name: str, known: Any) -> tuple[float, float] | None:
    if not file.has(name):
        return None
    low, high = file.pair(name)
    require(0.0 < low < high, name, [low, high])
    return low, high


@dataclass(frozen=True, eq=False)
class GameStatement(Statement):
    """Claim about the exact solution of a game and the distance of a critic from this solution.

    plant: aircraft at one scheduling value, of which the linear model is used, or matrices
    weights: weights of the game
    decimals: whether `distances` and `loop` are claimed for every decimal number that rounds to the
        stored doubles. `delta_min` and `modes` are claimed for the doubles only.
    critic: K (m, n), and P (n, n) and W (weights, 1) if the critic defines them
    gain_of_value: whether K is claimed to equal R⁻¹ B' P within `SAME_GAIN`, for the critic's P and
        for the P of its W
    distances: part X of the critic -> lower and upper bound of |X - X*| / |X*| (Frobenius norm)
    loop: lower and upper bound of the number of unstable modes of A - B K with the critic's K
    delta_min: a delta for which the game has no value and a delta for which it has a value, or None
    modes: lower and upper bound of the number of unstable modes of A, or None if `delta_min` is
        None
    """

    plant: Flight | Plant = entry(_read_plant)
    weights: Weights = part(Weights)
    decimals: bool = entry(lambda file, name, known: file.flag(name))
    critic: Mapping[str, np.ndarray] = entry(_read_critic, subject="critic", apart=True)
    gain_of_value: bool = entry(lambda file, name, known: file.flag(name))
    distances: Mapping[str, tuple[float, float]] = entry(_read_distances)
    loop: tuple[int, int] = entry(_read_bounds)
    delta_min: tuple[float, float] | None = entry(_read_delta_min, default=None)
    modes: tuple[int, int] | None = entry(_read_bounds, default=None)

    @property
    def hurwitz(self) -> bool | None:
        """True if A - B K is proved Hurwitz, False if proved not Hurwitz, otherwise None."""
        least, most = self.loop
        if most == 0:
            return True
        return False if least > 0 else None

    def check_consistent(self) -> None:
        """Raise Malformed if entries contradict each other."""
        if isinstance(self.plant, Flight):
            require(self.plant.low == self.plant.high, "range", self.plant.range)
            require(not self.plant.spread, "spread", self.plant.spread)
        else:
            require(not self.decimals, "decimals", self.decimals)
        require(len(self.critic) > 1 or not self.gain_of_value, "gain_of_value", True)
        require(self.loop is not None, "loop: missing entry")
        require((self.delta_min is None) == (self.modes is None), "modes", self.modes)


@dataclass(frozen=True, eq=False)
class SolutionBox:
    """Enclosure of the solution of the Riccati equation on a box, with states measured in `units`.

    Every entry of the solution differs from the same entry of P(s) by at most `reach`.

    units: units of the states, (n,), positive
    P: P(s), Taylor model of a symmetric matrix (n, n)
    reach: radius, a ball
    line: matrix H for the proof that A - S P is Hurwitz
    """

    units: np.ndarray
    P: TaylorModel
    reach: arb
    line: Line

    @classmethod
    def read(cls, entries: Fields, n: int) -> SolutionBox:
        """Return the enclosure stored in a certificate.

        n: number of states

        Raises Malformed for the first wrong entry.
        """
        units = entries.array("units", n)
        require(bool(np.all(units > 0.0)), "units")
        (rows,) = entries.balls("P", 1, n, n)
        for i in range(n):
            for j in range(i):
                same = bool(rows[i][j].mid() == rows[j][i].mid())
                require(same, f"{entries.where}: P: not symmetric")
                rows[j][i] = rows[i][j]
        reach = entries.balls("reach")
        require(bool(reach > 0), "reach")
        return cls(units, TaylorModel(arb_mat(rows)), reach, Line.read(entries, n, rated=False))


@dataclass(frozen=True, eq=False)
class PointTrim:
    """Enclosure of the trim at one scheduling value.

    center: unknown -> center c0, a constant
    radii: unknown -> radius about c0 that contains the trim of the stored doubles
    wide_radii: unknown -> radius about c0 that contains the trims of all decimal numbers that round
        to these doubles
    """

    center: dict[str, TaylorModel]
    radii: dict[str, arb]
    wide_radii: dict[str, arb]

    @classmethod
    def read(cls, entries: Fields, flight: Flight) -> PointTrim:
        """Return the trim stored in a certificate.

        The entry of each unknown is a list (center, radius, wide radius).

        Raises Malformed for the first wrong entry.
        """
        center = {}
        radii = {}
        wide_radii = {}
        for name in flight.unknowns:
            middle, radii[name], wide_radii[name] = entries.balls(name, 3)
            center[name] = TaylorModel(middle)
            require(bool(radii[name] > 0) and bool(radii[name] <= wide_radii[name]), entries.where)
        entries.close()
        return cls(center, radii, wide_radii)


@dataclass(frozen=True, eq=False)
class GameWitness(Witness):
    """Data for the proof of a statement about a game.

    trim: enclosure of the trim, or None for a plant given by matrices
    solution: enclosure of the solution at the game's delta
    loop: matrices H that count the unstable modes of A - B K
    modes: matrices H that count the unstable modes of A, [] if delta_min is not claimed
    value: enclosure of the solution at the upper bound of delta_min, or None if delta_min is not
        claimed
    refused: proof that the game has no value at the lower bound of delta_min. This is a solution
        whose lowest eigenvalue is negative, or frequencies, rad/s, between which the Hamiltonian
        matrix has an eigenvalue on the imaginary axis. None if delta_min is not claimed.
    """

    trim: PointTrim | None
    solution: SolutionBox
    loop: list[Line]
    modes: list[Line] = field(default_factory=list)
    value: SolutionBox | None = None
    refused: SolutionBox | Sequence[float] | None = None

    @classmethod
    def read(cls, entries: Fields, statement: GameStatement) -> GameWitness:
        """Return the witness of a statement about a game, stored in a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        n = len(statement.weights.Q)
        trim = None
        if isinstance(statement.plant, Flight):
            trim = PointTrim.read(entries.fields("trim"), statement.plant)
        else:
            assert isinstance(statement.plant, Plant)  # the only other kind
        solution = _closed_solution(entries.fields("solution"), n)
        loop = _lines(entries, "loop", n)
        if statement.delta_min is None:
            entries.close()
            return cls(trim, solution, loop)
        modes = _lines(entries, "modes", n)
        value = _closed_solution(entries.fields("value"), n)
        refused: Any = None
        if entries.has("frequencies"):
            refused = entries.array("frequencies", None).tolist()
        else:
            refused = _closed_solution(entries.fields("refused"), n)
        entries.close()
        return cls(trim, solution, loop, modes, value, refused)


def _closed_solution(entries: Fields, n: int) -> SolutionBox:
    solution = SolutionBox.read(entries, n)
    entries.close()
    return solution


def _lines(entries: Fields, name: str, n: int) -> list[Line]:
    lines = []
    for line in entries.items(name):
        lines.append(Line.read(line, n))
        line.close()
    return lines
