"""Test in doubles whether a certificate's claim is true, by another method than the checker's.

The test uses trims, eigenvalues and solutions of games at some scheduling values.
"""

from __future__ import annotations

from collections.abc import Iterator
from itertools import product
from types import SimpleNamespace
from typing import Any

import numpy as np
from proof_cases import between, delayed_abscissa, loop_in_doubles, model_of

import hfa
from controller import basis
from hfa import (
    Game,
    NoSolutionError,
    OperatingPoint,
    TrimCondition,
    linearize,
    solve,
    trim,
)
from hfa_aircraft.model import Model

Content = dict[str, Any]
#: Rounding error of doubles, compared with values that a certificate states with all digits.
ROUNDING = 1e-6
#: Relative distance from delta_min below which a solution in doubles is not certified.
NEAR = 1e-4


def false_claims(statement: Content, kind: str) -> list[str]:
    """Return descriptions of the false claims of a statement, or [] if no false claim is found."""
    if "critic" in statement:
        return list(_false_of_game(statement, kind))
    return list(_false_of_schedule(statement, kind))


class FlightInDoubles:
    """The trims of a statement's flight, computed in doubles."""

    def __init__(self, flight: Content, kind: str) -> None:
        model = model_of(kind) or hfa.aircraft(flight["model"]["dynamics"])
        self.flight = flight
        self.model: Model = model.with_parameters(**flight["parameters"])

    def point(self, value: float) -> OperatingPoint:
        """Return the trim at a scheduling value, which is in degrees if the scheduling variable is
        an angle.
        """
        scheduled = self.model.schedule
        in_model_unit = np.radians(value) if self.model.schedule_unit == "deg" else value
        if scheduled in self.model.parameters:
            model = self.model.with_parameters(**{scheduled: in_model_unit})
            return trim(model, TrimCondition(model, self.flight["imposed"]))
        imposed = self.flight["imposed"] | {scheduled: in_model_unit}
        return trim(self.model, TrimCondition(self.model, imposed))

    def values(self) -> list[float]:
        return np.linspace(*self.flight["range"], 5).tolist()

    def linear(self, value: float) -> tuple[np.ndarray, np.ndarray]:
        """Return A (n, n) and B (n, m) at a scheduling value."""
        point = self.point(value)
        model = linearize(point.model, point)
        return np.array(model.A), np.array(model.B)

    def named(self, value: float) -> dict[str, float]:
        """Return the values of the trim at a scheduling value, by name."""
        return dict(self.point(value).values)

    def false_claims(self) -> Iterator[str]:
        if not self.flight["trims"]:
            yield "no trim is stated"
        for stated in self.flight["trims"]:
            found = self.named(stated["breakpoint"])
            for name, value in stated["unknowns"].items():
                if abs(found[name] - value) > 2e-6 * self.model.signals[name].nominal:
                    yield f"the trim's {name} is {found[name]}"
        for value in self.values():
            found = self.named(value)
            for name, (least, most) in self.flight["limits"].items():
                slack = ROUNDING * self.model.signals[name].nominal
                if name in found and not least - slack <= found[name] <= most + slack:
                    yield f"{name} is {found[name]} at {value}"


def _false_of_schedule(statement: Content, kind: str) -> Iterator[str]:
    flight = FlightInDoubles(statement["flight"], kind)
    yield from flight.false_claims()
    for value in flight.values():
        A, B = flight.linear(value)
        yield from _false_counts("modes", statement["modes"], np.linalg.eigvals(A), value)
        if "delay" in statement.get("actuators", {}):
            abscissae = list(_abscissae(statement, A, B, value))
            least = next(run for run in statement["loop"] if run[0] <= value <= run[1])[3]
            if least == 0 and max(abscissae) >= 0.0:
                yield f"the loop at {value} grows by {max(abscissae)}"
            continue
        eigenvalues = np.linalg.eigvals(_closed_loop(statement, flight.model, A, B, value))
        yield from _false_counts("loop", statement["loop"], eigenvalues, value)
        proved = all(run[3] == 0 for run in statement["loop"] if run[0] <= value <= run[1])
        if proved and eigenvalues.real.max() > -statement["decay_rate"]:
            yield f"decay rate {-eigenvalues.real.max()} at {value}"


def _false_counts(
    name: str, runs: list[list[float]], eigenvalues: np.ndarray, value: float
) -> Iterator[str]:
    count = int((eigenvalues.real > 0.0).sum())
    here = [run for run in runs if run[0] <= value <= run[1]]
    if not here:
        yield f"nothing is said of {name} at {value}"
    if not any(least <= count <= most for _, _, least, most in here):
        yield f"{name}: {count} unstable modes at {value}"


def _loop_of(statement: Content) -> SimpleNamespace:
    """Return the controller and the actuators of a statement, in the form of `loop_in_doubles`."""
    numbers = {
        name: np.array(entry) if name in ("breakpoints", *"ABCD") else entry
        for name, entry in statement["controller"].items()
    }
    g = len(numbers["breakpoints"])
    k = numbers["A"].shape[1]
    a, p = len(numbers["inputs"]), len(numbers["measurements"])
    for name, sides in {"A": (k, k), "B": (k, p), "C": (a, k), "D": (a, p)}.items():
        numbers[name] = numbers[name].reshape(g, *sides)
    actuators = statement.get("actuators")
    held = None
    if actuators is not None:
        held = SimpleNamespace(
            **{name: np.array(entry) for name, entry in actuators.items() if name != "order"},
            order=tuple(int(order) for order in actuators["order"]),
        )
    return SimpleNamespace(controller=SimpleNamespace(**numbers), actuators=held)


def _closed_loop(
    statement: Content, model: Model, A: np.ndarray, B: np.ndarray, value: float
) -> np.ndarray:
    """Return the matrix of the closed loop without actuators or with fixed ones.

    A, B: linear model of the aircraft at the scheduling value
    """
    loop = _loop_of(statement)
    if loop.actuators is None:
        controller = loop.controller
        places = [model.linear.index(name) for name in controller.measurements]
        moved = B[:, [tuple(model.inputs).index(name) for name in controller.inputs]]
        tables = (getattr(controller, name) for name in "ABCD")
        A_c, B_c, C_c, D_c = (between(controller.breakpoints, each, value) for each in tables)
        y = np.eye(len(A))[places]
        return np.block([[A + moved @ D_c @ y, moved @ C_c], [B_c @ y, A_c]])
    parts = loop_in_doubles(loop, A, B, value)
    bandwidths = np.zeros(len(parts.base))
    second = 0
    for i, order in enumerate(loop.actuators.order):
        bandwidths[len(A) + i] = loop.actuators.bandwidth[i]
        if order == 2:
            bandwidths[len(A) + len(loop.actuators.order) + second] = loop.actuators.bandwidth[i]
            second += 1
    arriving = loop.actuators.effectiveness[:, None] * parts.U
    return parts.base + bandwidths[:, None] * (parts.lag + parts.G @ arriving)


def _abscissae(statement: Content, A: np.ndarray, B: np.ndarray, value: float) -> Iterator[float]:
    """Yield the spectral abscissa of the loop for each combination of ends of the uncertain
    intervals.
    """
    actuators = statement["actuators"]
    loop = _loop_of(statement)
    count = len(loop.controller.inputs)
    lates = (0.0, actuators["delay"])
    for w, share, late in product(actuators["bandwidth"], actuators["effectiveness"], lates):
        yield delayed_abscissa(loop, A, B, w, share * np.ones(count), late, value)


def _false_of_game(statement: Content, kind: str) -> Iterator[str]:
    if "A" in statement["plant"]:
        A = np.array(statement["plant"]["A"])
        B = np.array(statement["plant"]["B"])
    else:
        flight = FlightInDoubles(statement["plant"], kind)
        yield from flight.false_claims()
        A, B = flight.linear(statement["plant"]["range"][0])
    weights = {name: np.array(statement["weights"][name]) for name in "QRE"}
    game = Game(A=A, B=B, delta=float(statement["weights"]["delta"]), **weights)
    exact = solve(game)
    critic = {name: np.array(values) for name, values in statement["critic"].items()}
    targets = {"K": exact.K, "P": exact.P}
    if "W" in critic:
        W = basis("quadratic", len(A)).weights(exact.P)
        targets["W"] = np.pad(W, (0, len(critic["W"]) - len(W)))[:, None]
    for name, values in critic.items():
        size = np.linalg.norm(targets[name])
        distance = np.linalg.norm(values - targets[name]) / size
        least, most = statement["distances"].get(name, (np.inf, -np.inf))
        if not least - ROUNDING <= distance <= most + ROUNDING:
            yield f"the distance of {name} is {distance}"
    loop = np.linalg.eigvals(A - B @ critic["K"])
    yield from _false_counts("loop", [[0.0, 0.0, *statement["loop"]]], loop, 0.0)
    if "delta_min" in statement:
        yield from _false_counts(
            "modes", [[0.0, 0.0, *statement["modes"]]], np.linalg.eigvals(A), 0.0
        )
        for delta, has_value in zip(statement["delta_min"], (False, True), strict=True):
            if _has_value(game.with_delta(delta * (1 + (NEAR if has_value else -NEAR)))):
                if not has_value:
                    yield f"there is a value at {delta}"
            elif has_value:
                yield f"there is no value at {delta}"


def _has_value(game: Game) -> bool:
    try:
        solve(game)
    except NoSolutionError:
        return False
    return True
