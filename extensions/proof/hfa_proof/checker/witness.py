"""Data for the proofs of statements about schedules, games and interpolated models.

The data are not part of the claim. In a box of scheduling values, the value is
center + s radius with -1 <= s <= 1.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from flint import arb, arb_mat

from hfa_proof.checker.reading import Fields, require
from hfa_proof.checker.statement import (
    Flight,
    GameStatement,
    ModelsStatement,
    Plant,
    ScheduleStatement,
    UncertainActuators,
    loop_size,
)
from verification.enclosure.series import TaylorModel


@dataclass(frozen=True, eq=False)
class TrimBox:
    """Enclosure of the trims at all scheduling values from `low` to `high`.

    Each unknown differs from c0 + c1 s + c2 s² + Σ z_k t_k by at most its radius. t_k are the
    errors of the parameters in units of their half-widths, |t_k| <= 1.

    low, high: ends of the box of scheduling values
    polynomials: unknown -> (c0, c1, c2, z_1, ...)
    radii: unknown -> radius
    """

    low: float
    high: float
    polynomials: dict[str, list[arb]]
    radii: dict[str, arb]

    @classmethod
    def read(cls, entries: Fields, flight: Flight) -> TrimBox:
        """Return the enclosure stored in the entries `range` and `trim` of a certificate.

        Raises Malformed for the first wrong entry.
        """
        low, high = entries.pair("range")
        require(flight.low <= low < high <= flight.high, "range", [low, high])
        trims = entries.fields("trim")
        polynomials = {}
        radii = {}
        for name in flight.unknowns:
            radii[name], *polynomials[name] = trims.balls(name, 4 + len(flight.spread))
            require(bool(radii[name] > 0), trims.where, name)
        trims.close()
        return cls(low, high, polynomials, radii)


@dataclass(frozen=True, eq=False)
class Line:
    """Matrix H that counts the eigenvalues of a matrix A on each side of the line Re λ = -rate.

    A has as many eigenvalues with Re λ > -rate as H has negative eigenvalues.

    H: symmetric matrix, (n, n)
    turn: coordinates in which the signs of the eigenvalues of H are decided, (n, n)
    rate: 1/s
    """

    H: np.ndarray
    turn: np.ndarray
    rate: float = 0.0

    @classmethod
    def read(cls, entries: Fields, n: int, *, rated: bool = True) -> Line:
        """Return the matrix H and the line stored in a certificate.

        n: number of states
        rated: whether to read the entry `rate`. Otherwise the rate is 0.

        Raises Malformed for the first wrong entry.
        """
        rate = entries.number("rate") if rated else 0.0
        return cls(entries.symmetric("H", n), entries.array("turn", n, n), rate)


@dataclass(frozen=True, eq=False)
class Piece:
    """Lyapunov function V = ζ'H ζ for actuators with a bandwidth in an interval.

    bandwidth: lowest and highest bandwidth, rad/s
    H: symmetric matrix, (n, n)
    X: multipliers of the delays, then of the effectiveness, (2 a,)
    turn: coordinates of (ζ, d, e) in which the condition is tested, (n + 2 a, n + 2 a)
    """

    bandwidth: tuple[float, float]
    H: np.ndarray
    X: np.ndarray
    turn: np.ndarray

    @classmethod
    def read(cls, entries: Fields, n: int, a: int) -> Piece:
        """Return the Lyapunov function stored in a certificate.

        n: number of states of the loop
        a: number of actuators

        Raises Malformed for the first wrong entry.
        """
        bandwidth = entries.pair("bandwidth", least=0.0)
        H = entries.symmetric("H", n)
        piece = cls(
            bandwidth, H, entries.array("X", 2 * a), entries.array("turn", *[n + 2 * a] * 2)
        )
        entries.close()
        return piece


@dataclass(frozen=True, eq=False)
class ModesBox:
    """Data for the proof of the number of unstable modes on a box.

    trim: enclosure of the trims on the box
    proof: a matrix that counts eigenvalues, or Lyapunov functions that together cover the
        bandwidths of uncertain actuators
    """

    trim: TrimBox
    proof: Line | list[Piece]


@dataclass(frozen=True, eq=False)
class Motion:
    """Lyapunov function V = ζ'P ζ for a moving scheduling value, with P linear between breakpoints.

    breakpoints: scheduling values, (l,)
    P: symmetric matrices, (l, n, n)
    boxes: pairs of an enclosure of trims and coordinates (n, n) in which the condition is tested
    """

    breakpoints: np.ndarray
    P: np.ndarray
    boxes: list[tuple[TrimBox, np.ndarray]]

    @classmethod
    def read(cls, entries: Fields, flight: Flight, n: int) -> Motion:
        """Return the Lyapunov function stored in a certificate.

        entries: reader of the entry `motion`
        flight: aircraft whose trims the boxes enclose
        n: number of states of the loop

        Raises Malformed for the first wrong entry.
        """
        breakpoints = entries.increasing("breakpoints")
        P = entries.array("P", len(breakpoints), n, n)
        require(np.array_equal(P, P.transpose(0, 2, 1)), f"{entries.where}: P: not symmetric")
        boxes = []
        for box in entries.items("boxes"):
            trim = TrimBox.read(box, flight)
            boxes.append((trim, box.array("turn", n, n)))
            box.close()
        entries.close()
        return cls(breakpoints, P, boxes)


@dataclass(frozen=True, eq=False)
class ScheduleWitness:
    """Data for the proof of a statement about a schedule.

    loop: boxes that together prove the numbers of unstable modes of the loop
    modes: boxes that together prove the numbers of unstable modes of the aircraft
    motion: Lyapunov function for a moving scheduling value, or None
    """

    loop: list[ModesBox]
    modes: list[ModesBox]
    motion: Motion | None = None

    @classmethod
    def read(cls, entries: Fields, statement: ScheduleStatement) -> ScheduleWitness:
        """Return the witness of a statement about a schedule, stored in a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        flight = statement.flight
        actuators = statement.actuators
        n = len(flight.model.linear)
        size = loop_size(flight.model, statement.controller, actuators)
        loop = []
        for box in entries.items("loop"):
            trim = TrimBox.read(box, flight)
            proof: Line | list[Piece]
            if isinstance(actuators, UncertainActuators):
                count = len(actuators.order)
                proof = [Piece.read(piece, size, count) for piece in box.items("pieces")]
            else:
                proof = Line.read(box, size)
            box.close()
            loop.append(ModesBox(trim, proof))
        modes = []
        for box in entries.items("modes"):
            modes.append(ModesBox(TrimBox.read(box, flight), Line.read(box, n)))
            box.close()
        motion = None
        if statement.scheduled_rate is not None:
            motion = Motion.read(entries.fields("motion"), flight, size)
        entries.close()
        return cls(loop, modes, motion)


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
    def read(cls, entries: Fields, n: int, orders: int) -> SolutionBox:
        """Return the enclosure stored in a certificate.

        n: number of states
        orders: number of coefficients of the polynomial P(s)

        Raises Malformed for the first wrong entry.
        """
        units = entries.array("units", n)
        require(bool(np.all(units > 0.0)), "units")
        coefficients = entries.balls("P", orders, n, n)
        for rows in coefficients:
            for i in range(n):
                for j in range(i):
                    same = bool(rows[i][j].mid() == rows[j][i].mid())
                    require(same, f"{entries.where}: P: not symmetric")
                    rows[j][i] = rows[i][j]
        reach = entries.balls("reach")
        require(bool(reach > 0), "reach")
        P = TaylorModel(*(arb_mat(rows) for rows in coefficients))
        return cls(units, P, reach, Line.read(entries, n, rated=False))


@dataclass(frozen=True, eq=False)
class PointTrim:
    """Enclosure of the trim at one scheduling value.

    center: unknown -> (c0, 0, 0) with the center c0
    radii: unknown -> radius about c0 that contains the trim of the stored doubles
    wide_radii: unknown -> radius about c0 that contains the trims of all decimal numbers that round
        to these doubles
    """

    center: dict[str, list[arb]]
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
            center[name] = [middle, arb(0), arb(0)]
            require(bool(radii[name] > 0) and bool(radii[name] <= wide_radii[name]), entries.where)
        entries.close()
        return cls(center, radii, wide_radii)


@dataclass(frozen=True, eq=False)
class GameWitness:
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
            assert isinstance(statement.plant, Plant)
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


@dataclass(frozen=True, eq=False)
class ModelsWitness:
    """Data for the proof of a statement about interpolated models.

    cells: enclosures of the trims and of the solution of the game on boxes that cover the interval
    """

    cells: list[tuple[TrimBox, SolutionBox]]

    @classmethod
    def read(cls, entries: Fields, statement: ModelsStatement) -> ModelsWitness:
        """Return the witness of a statement about interpolated models, stored in a certificate.

        statement: the statement, which determines the sizes of the matrices

        Raises Malformed for the first wrong entry.
        """
        n = len(statement.weights.Q)
        cells = []
        for cell in entries.items("cells"):
            trim = TrimBox.read(cell, statement.flight)
            cells.append((trim, SolutionBox.read(cell, n, orders=3)))
            cell.close()
        entries.close()
        return cls(cells)


def _closed_solution(entries: Fields, n: int) -> SolutionBox:
    solution = SolutionBox.read(entries, n, orders=1)
    entries.close()
    return solution


def _lines(entries: Fields, name: str, n: int) -> list[Line]:
    lines = []
    for line in entries.items(name):
        lines.append(Line.read(line, n))
        line.close()
    return lines


def trim_content(trim: TrimBox) -> dict[str, Any]:
    """Return an enclosure of trims in the form that is stored in a certificate, with doubles."""
    numbers = {
        name: [float(trim.radii[name]), *map(float, polynomial)]
        for name, polynomial in trim.polynomials.items()
    }
    return {"range": [trim.low, trim.high], "trim": numbers}
