"""Statement of a certificate about a gain schedule or controller, and its witness.

The checker interprets or refuses every entry. The digest covers all entries, and reports show them.
"""

from __future__ import annotations

from dataclasses import dataclass
from itertools import pairwise
from types import SimpleNamespace
from typing import Any, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.fields import Fields, Stated, Statement, Witness, entry, part, require
from hfa_prove.statements.flight import Flight, Line, TrimBox


class Run(NamedTuple):
    """Bounds on the number of unstable modes over a range of scheduling values.

    An unstable mode is an eigenvalue with positive real part. If `least` equals `most`, no
    eigenvalue is on the imaginary axis.

    low, high: ends of the range
    least, most: lowest and highest number at every scheduling value of the range
    """

    low: float
    high: float
    least: int
    most: int


def _read_dynamics(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return the matrices A (g, k, k) of a controller with any number k of states."""
    count = len(known.breakpoints)
    tables = file.array(name, count, None, None)
    k = tables.shape[1]
    require(tables.size == count * k**2, name, tables.shape)
    return tables.reshape(count, k, k)


def _read_inputs(file: Fields, name: str, known: Any) -> tuple[str, ...]:
    inputs = file.texts(name, known.model.inputs)
    require(len(set(inputs)) == len(inputs) > 0, name, inputs)
    return inputs


def _read_measurements(file: Fields, name: str, known: Any) -> tuple[str, ...]:
    positions = [f"{each}_position" for each in known.inputs]
    measurements = file.texts(name, (*measurable(known.model), *positions))
    require(bool(measurements), name)
    return measurements


def _table(rows: str, columns: str) -> Any:
    """Return the declaration of a field with a matrix for each breakpoint.

    rows, columns: the fields whose lengths are the sides of the matrices. The states are counted by
        A.
    """

    def read(file: Fields, name: str, known: Any) -> np.ndarray:
        states = known.A.shape[1]
        sides = [states if side == "A" else len(getattr(known, side)) for side in (rows, columns)]
        return file.array(name, len(known.breakpoints), *sides)

    return entry(read, subject="gains")


@dataclass(frozen=True, eq=False, kw_only=True)
class Controller(Stated):
    """Controller x_c' = A x_c + B y, u = C x_c + D y.

    The matrices are linear in the scheduling value between breakpoints. A gain u = -K x is a
    controller without states and with D = -K.

    breakpoints: scheduling values, (g,), increasing
    inputs: (a,), names of the inputs that u commands
    measurements: (p,), names of linear states, outputs, parts of outputs, and INPUT_position of
        actuators
    A: (g, k, k)
    B: (g, k, p)
    C: (g, a, k)
    D: (g, a, p)
    """

    breakpoints: np.ndarray = entry(
        lambda file, name, known: file.increasing(name), subject="gains"
    )
    inputs: tuple[str, ...] = entry(_read_inputs, subject="gains")
    measurements: tuple[str, ...] = entry(_read_measurements, subject="gains")
    A: np.ndarray = entry(_read_dynamics, subject="gains")
    B: np.ndarray = _table("A", "measurements")
    C: np.ndarray = _table("inputs", "A")
    D: np.ndarray = _table("inputs", "measurements")

    def outputs(self, model: Model) -> tuple[str, ...]:
        """Return the names of the outputs that the controller measures, as a whole or in part."""
        names = (model.part(name)[0] for name in self.measurements)
        return tuple(dict.fromkeys(name for name in names if name in model.outputs))


def _read_orders(file: Fields, name: str, known: Any) -> tuple[int, ...]:
    orders = file.array(name, len(known.controller.inputs)).tolist()
    require(all(order in (1.0, 2.0) for order in orders), name, orders)
    return tuple(int(order) for order in orders)


def _read_positive(file: Fields, name: str, known: Any) -> np.ndarray:
    """Return one positive number for each input of the controller."""
    values = file.array(name, len(known.controller.inputs))
    require(bool(np.all(values > 0.0)), name, values.tolist())
    return values


def _read_bandwidths(file: Fields, name: str, known: Any) -> tuple[float, float]:
    low, high = file.pair(name)
    require(low > 0.0, name, [low, high])
    return low, high


@dataclass(frozen=True, eq=False)
class FixedActuators(Stated):
    """Actuators with known parameters, one for each input of the controller.

    First order: a' = ω (λ u - a). Second order: a'' = ω² (λ u - a) - 2 d ω a'.

    order: 1 or 2, (a,)
    damping: d, used only for order 2, (a,)
    bandwidth: ω, rad/s, (a,)
    effectiveness: λ, (a,)
    """

    order: tuple[int, ...] = entry(_read_orders, subject="actuators")
    damping: np.ndarray = entry(_read_positive, subject="actuators")
    bandwidth: np.ndarray = entry(_read_positive, subject="actuators")
    effectiveness: np.ndarray = entry(_read_positive, subject="actuators")


@dataclass(frozen=True, eq=False)
class UncertainActuators(Stated):
    """Actuators whose bandwidth ω, effectiveness λ(t) and delay τ(t) are uncertain.

    order: 1 or 2, (a,)
    damping: d, used only for order 2, (a,)
    bandwidth: lowest and highest ω, rad/s, constant and equal for all inputs
    effectiveness: lowest and highest λ, which varies independently for each input
    delay: largest τ, s, which varies independently for each input
    """

    order: tuple[int, ...] = entry(_read_orders, subject="actuators")
    damping: np.ndarray = entry(_read_positive, subject="actuators")
    bandwidth: tuple[float, float] = entry(_read_bandwidths, subject="actuators")
    effectiveness: tuple[float, float] = entry(
        lambda file, name, known: file.pair(name, least=0.0), subject="actuators"
    )
    delay: float = entry(
        lambda file, name, known: file.number(name, least=0.0), subject="actuators"
    )


Actuators = FixedActuators | UncertainActuators


def _read_actuators(file: Fields, name: str, known: Any) -> Actuators | None:
    """Return the actuators, which are uncertain if they have a delay, or None if there are none."""
    if not file.has(name):
        return None
    stated = file.fields(name)
    return (UncertainActuators if stated.has("delay") else FixedActuators).read(stated, known)


def _runs_of(size: Any) -> Any:
    """Return the reader of an entry with ranges of the scheduling value and numbers of modes.

    size: namespace of the entries -> number of eigenvalues
    """
    return lambda file, name, known: _read_runs(file, name, known.flight, size(known))


@dataclass(frozen=True, eq=False)
class ScheduleStatement(Statement):
    """Claim about the loop of an aircraft, a controller and optional actuators.

    The claim covers every scheduling value of the aircraft's trims.

    flight: aircraft and its trims
    controller: the controller
    actuators: the actuators, or None
    loop: numbers of unstable modes of the loop, for consecutive ranges of the scheduling value. A
        range with bounds from 0 to the number of all modes claims nothing.
    modes: numbers of unstable modes of the aircraft alone, in the same form
    decay_rate: bound, 1/s, with Re λ < -decay_rate for every eigenvalue λ of the loop in ranges
        without unstable modes. 0 if there is no such range or the actuators are uncertain.
    scheduled_rate: largest rate of the scheduling value, per s, at which the loop is stable, or
        None
    """

    flight: Flight = part(Flight)
    controller: Controller = entry(
        lambda file, name, known: Controller.read(
            file.fields(name), SimpleNamespace(model=known.flight.model)
        )
    )
    actuators: Actuators | None = entry(_read_actuators)
    loop: tuple[Run, ...] = entry(
        _runs_of(lambda known: loop_size(known.flight.model, known.controller, known.actuators))
    )
    modes: tuple[Run, ...] = entry(_runs_of(lambda known: len(known.flight.model.linear)))
    decay_rate: float = entry(lambda file, name, known: file.number(name, least=0.0))
    scheduled_rate: float | None = entry(
        lambda file, name, known: file.number(name, above=0.0) if file.has(name) else None,
        default=None,
    )

    def check_consistent(self) -> None:
        """Raise Malformed for rates that are not claimed."""
        hurwitz = any(run.most == 0 for run in self.loop)
        require(hurwitz or self.decay_rate == 0.0, "decay_rate", self.decay_rate)
        if isinstance(self.actuators, UncertainActuators):
            still = self.scheduled_rate is None and self.decay_rate == 0.0
            require(still, "decay_rate", self.decay_rate)


def measurable(model: Model) -> tuple[str, ...]:
    """Return the names of signals of the model that a controller may measure.

    These are the linear states, the outputs and the parts of outputs.
    """
    names = []
    for name in model.measurable:
        whole, _ = model.part(name)
        if name in model.linear or whole in model.outputs:
            names.append(name)
    return tuple(names)


def loop_size(model: Model, controller: Controller, actuators: Actuators | None) -> int:
    """Return the number of states of the closed loop: aircraft, actuators and controller."""
    size = len(model.linear) + controller.A.shape[1]
    return size if actuators is None else size + sum(actuators.order)


def _read_runs(entries: Fields, name: str, flight: Flight, size: int) -> tuple[Run, ...]:
    """Return the ranges of an entry with rows [low, high, least, most], in ascending order.

    entries: reader of the object that contains the entry
    name: name of the entry
    flight: aircraft and its trims
    size: number of eigenvalues

    Raises Malformed unless the ranges cover all scheduling values of the trims without a gap.
    """
    runs: list[Run] = []
    for row in entries.array(name, None, 4).tolist():
        low, high, least, most = row
        run = Run(low, high, int(least), int(most))
        require(row == list(run) and low < high, name, row)
        require(0 <= run.least <= run.most <= size, name, row)
        runs.append(run)
    require(bool(runs), name)
    require(runs[0].low == flight.low and runs[-1].high == flight.high, name)
    for first, second in pairwise(runs):
        require(first.high == second.low, name)
    return tuple(runs)


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
class ScheduleWitness(Witness):
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
