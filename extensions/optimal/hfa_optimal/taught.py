"""A network that is taught by the predictive policy, and the files that deploy it.

  v = b (-K z) + (1 - b) V N(z / Z, tanh(4 z / Z)),    b = exp(-z'Pz / level)

N is a network with two hidden layers of tanh, Z and V are sizes of the taught states and inputs. At
the trim, the gradient is -K whatever the network, because 1 - b and its gradient are 0.

Source: Kingma and Ba, arXiv 1412.6980 (Adam).
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path
from typing import Any

import numpy as np

from hfa_flight.policies.deployment.toml_text import toml_text
from hfa_flight.problem import FlightProblem
from hfa_optimal.held_model import HeldModel
from hfa_optimal.predictive import Predictive, policy_of
from hfa_support.errors import missing_package
from hfa_support.files import write_text
from hfa_support.progress import Progress

#: Fraction by which the teacher's envelope is narrowed.
TEACHER_MARGIN = 0.1
#: Hidden units of each layer, and slope of the second features.
_HIDDEN = 64
_STEEP = 4.0
#: Flights of the teacher, and steps of the fit to them.
_FLIGHTS = 24
_FIT_STEPS = 3000
_BATCH = 512
_FIT_RATE = 3e-3
#: One label flight of so many, and one flight of so many in a gradient step, begins in the box
#: about the trim, shrunk by up to so many decades.
_LABELLED = 3
_STEPPED = 12
_DECADES = 1.0
#: Gradient steps through flights, their rate, and flights of a step.
_FLIGHT_STEPS = 200
_FLIGHT_RATE = 3e-4
_STEP_FLIGHTS = 48
#: Price of exceeded limits in half ranges, relative to z'Pz at the start, and fraction by which the
#: limits are narrowed.
_PRICE = 0.25
_MARGIN = 0.03
#: Flights of a step that continue earlier ones.
_CONTINUED = 6
#: Duration of a flight in horizons of a plan, and its largest number of samples.
_HORIZONS = 2.0
_MOST_SAMPLES = 130
#: A flight need not be continued below the first fraction of the blending level, and is lost beyond
#: the second value, in nominal units. Farther than the third, no state is computed.
_NEARLY = 0.5
_LOST = 50.0
_FARTHEST = 1e6
#: Largest magnitude of the gradient of a mean logarithm of costs by the states of a flight.
_LARGEST = 2.0
#: Number of tried blending levels and factor between two of them. Duration of their flights in
#: taught ones, and fraction of a level below which a flight ends at the trim.
_LEVELS = 5
_FACTOR = 10.0
_LONGER = 10
_RETURNED = 0.05


class Network:
    """The policy of the module's first lines, in nominal units.

    parameters: weights and biases of the three layers
    K: gain at the trim, (m, k)
    P: matrix of z'Pz, (k, k)
    level: level of z'Pz at which the network and the linear policy blend
    of_states, of_inputs: Z (k,) and V (m,)
    """

    def __init__(
        self,
        K: np.ndarray,
        P: np.ndarray,
        level: float,
        of_states: np.ndarray,
        of_inputs: np.ndarray,
    ) -> None:
        self.K, self.P, self.level = K, P, level
        self.of_states, self.of_inputs = of_states, of_inputs
        m, k = K.shape
        rng = np.random.default_rng(0)
        sizes = (2 * k, _HIDDEN, _HIDDEN, m)
        self.parameters = []
        for before, after in pairwise(sizes):
            self.parameters += [rng.normal(size=(before, after)) / np.sqrt(before), np.zeros(after)]
        self.parameters[4] *= 0.3

    def __call__(self, z: np.ndarray) -> tuple[np.ndarray, tuple[np.ndarray, ...]]:
        """Return the inputs before their limits, (N, m), and what `gradients` needs.

        z: states of the linear model, (N, k)
        """
        W1, b1, W2, b2, W3, b3 = self.parameters
        y = z / self.of_states
        features = np.hstack([y, np.tanh(_STEEP * y)])
        first = np.tanh(features @ W1 + b1)
        second = np.tanh(first @ W2 + b2)
        out = self.of_inputs * (second @ W3 + b3)
        blend = np.exp(-np.einsum("ni,ij,nj->n", z, self.P, z) / self.level)[:, None]
        linear = -z @ self.K.T
        return blend * linear + (1.0 - blend) * out, (
            z,
            features,
            first,
            second,
            out,
            blend,
            linear,
        )

    def gradients(
        self, kept: tuple[np.ndarray, ...], by_inputs: np.ndarray
    ) -> tuple[list[np.ndarray], np.ndarray]:
        """Return the gradients of a cost by the parameters, and by z (N, k).

        kept: second result of the call
        by_inputs: gradient of the cost by the inputs before their limits, (N, m)
        """
        z, features, first, second, out, blend, linear = kept
        _, _, W2, _, W3, _ = self.parameters
        W1 = self.parameters[0]
        last = by_inputs * (1.0 - blend) * self.of_inputs
        middle = (last @ W3.T) * (1.0 - second**2)
        begin = (middle @ W2.T) * (1.0 - first**2)
        of_parameters = [
            features.T @ begin,
            begin.sum(0),
            first.T @ middle,
            middle.sum(0),
            second.T @ last,
            last.sum(0),
        ]
        k = len(self.of_states)
        by_features = begin @ W1.T
        steep = features[:, k:]
        by_y = by_features[:, :k] + by_features[:, k:] * _STEEP * (1.0 - steep**2)
        by_z = by_y / self.of_states - (by_inputs * blend) @ self.K
        by_blend = (by_inputs * (linear - out)).sum(1, keepdims=True)
        by_z += by_blend * blend * (-2.0 / self.level) * (z @ self.P)
        return of_parameters, by_z


class _Adam:
    """Adam's gradient steps on a list of arrays, at a rate that falls to 0."""

    def __init__(self, parameters: list[np.ndarray], rate: float, steps: int) -> None:
        self._parameters = parameters
        self._rate, self._steps, self._count = rate, steps, 0
        self._means = [np.zeros_like(each) for each in parameters]
        self._squares = [np.zeros_like(each) for each in parameters]

    def step(self, gradients: list[np.ndarray]) -> None:
        """Change the parameters by one step."""
        rate = 0.5 * self._rate * (1.0 + np.cos(np.pi * self._count / self._steps)) + 1e-5
        self._count += 1
        for parameter, gradient, mean, square in zip(
            self._parameters, gradients, self._means, self._squares, strict=True
        ):
            mean += 0.1 * (gradient - mean)
            square += 0.01 * (gradient**2 - square)
            scale = np.sqrt(square / (1.0 - 0.99**self._count)) + 1e-9
            parameter -= rate * mean / (1.0 - 0.9**self._count) / scale


@dataclass(frozen=True, eq=False)
class Lesson:
    """What a network is taught, and how. States and inputs are in nominal values.

    teacher: predictive policy
    flights: costs of _STEP_FLIGHTS flights
    center, half_widths: box of initial deviations, (k,) each
    rng: random numbers
    """

    teacher: Predictive
    flights: FlightCosts
    center: np.ndarray
    half_widths: np.ndarray
    rng: np.random.Generator

    def starts(self, count: int, one_of: int) -> np.ndarray:
        """Return random initial deviations from the box, one of `one_of` about the trim,
        (count, k).
        """
        is_far = np.arange(count) % one_of > 0
        y = self.rng.uniform(-1.0, 1.0, (count, len(self.center)))
        shares = np.where(is_far, 1.0, 10.0 ** -self.rng.uniform(0.0, _DECADES, count))
        return (self.center * is_far[:, None] + self.half_widths * y) * shares[:, None]

    @property
    def samples(self) -> int:
        """Number of samples of a taught flight."""
        horizon = _HORIZONS * self.teacher.controller.planner.grid.horizon
        return min(_MOST_SAMPLES, int(np.ceil(horizon / self.teacher.dt)))

    def labels(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the states and inputs of the teacher's flights, (N, k) and (N, m)."""
        controller = self.teacher.controller
        planner = controller.planner
        k, n, _ = planner.scaled.sizes
        calm = np.zeros(planner.model.disturbances)
        states, inputs = [], []
        for start in self.starts(_FLIGHTS, _LABELLED):
            controller.reset()
            z = np.pad(start, (0, n - k))
            for _ in range(self.samples):
                states.append(z[:k])
                inputs.append(controller(z))
                z = planner.model.after(z, inputs[-1], calm, planner.grid.dt)
        return np.array(states), np.array(inputs)

    def level(self, K: np.ndarray, P: np.ndarray, least: float) -> float:
        """Return the largest level of z'Pz from which all flights of -Kz end at the trim.

        least: first level, from which others follow by factors of _FACTOR
        """
        y = np.random.default_rng(0).normal(size=(_STEP_FLIGHTS, len(P)))
        y /= np.linalg.norm(y, axis=1)[:, None]
        on_level = np.linalg.solve(np.linalg.cholesky(P).T, y.T).T
        for level in least * _FACTOR ** np.arange(_LEVELS):
            starts = np.sqrt(_FACTOR * level) * on_level
            _, z, _ = self.flights.flown(lambda z: (-z @ K.T, None), starts, _LONGER * self.samples)
            z = z[:, : len(P)]
            if not (np.einsum("ni,ij,nj->n", z, P, z) < _RETURNED * _FACTOR * level).all():
                break
        return float(level)

    def fit(self, network: Network, states: np.ndarray, inputs: np.ndarray) -> None:
        """Fit the network to labels. Beyond a limit, a label is met by any larger command."""
        lowest, highest = self.teacher.controller.planner.scaled.input_limits
        adam = _Adam(network.parameters, _FIT_RATE, _FIT_STEPS)
        weights = 1.0 / (0.1 + np.linalg.norm(states / network.of_states, axis=1))
        weights /= weights.mean()
        for _ in range(_FIT_STEPS):
            chosen = self.rng.integers(0, len(states), _BATCH)
            v, kept = network(states[chosen])
            label = inputs[chosen]
            error = (v - label) / network.of_inputs
            error[((label >= highest) & (v > highest)) | ((label <= lowest) & (v < lowest))] = 0.0
            pull = weights[chosen][:, None] * np.clip(error, -0.5, 0.5)
            gradients, _ = network.gradients(kept, pull / network.of_inputs / _BATCH)
            adam.step(gradients)

    def improve(self, network: Network, progress: Progress | None) -> None:
        """Change the network by gradient steps through flights of the model.

        Some flights of a step continue flights of the step before that have not returned, which
        teaches the network to return from wherever it leads.
        """
        adam = _Adam(network.parameters, _FLIGHT_RATE, _FLIGHT_STEPS)
        continued = self.starts(_CONTINUED, _STEPPED)
        for number in range(_FLIGHT_STEPS):
            starts = np.vstack([self.starts(_STEP_FLIGHTS - _CONTINUED, _STEPPED), continued])
            ends, gradients = self.flights(network, starts, self.samples)
            adam.step(gradients)
            ends = ends[np.abs(ends).max(axis=1) < _LOST]
            away = np.einsum("ni,ij,nj->n", ends, network.P, ends) > _NEARLY * network.level
            going = self.rng.permutation(ends[away])
            continued = np.vstack([going, self.starts(_CONTINUED, _STEPPED)])[:_CONTINUED]
            if progress is not None:
                progress(number + 1, _FLIGHT_STEPS)


class FlightCosts:
    """Mean logarithm of the costs of _STEP_FLIGHTS sampled flights, and its gradient.

    The price of an exceeded limit grows with z'Pz at the start of a flight.

    teacher: policy whose problem, samples and weights the flights have
    """

    def __init__(self, teacher: Predictive) -> None:
        planner = teacher.controller.planner
        self._scaled = planner.scaled
        self._W = planner.grid.at(0).weights[0]
        self._model = HeldModel(self._scaled, np.full(_STEP_FLIGHTS, teacher.dt))
        lowest, highest = self._scaled.state_limits
        self._limits = (1.0 - _MARGIN) * lowest, (1.0 - _MARGIN) * highest
        self._half = np.where(np.isfinite(highest - lowest), 0.5 * (highest - lowest), 1.0)

    def flown(
        self,
        policy: Callable[[np.ndarray], tuple[np.ndarray, Any]],
        starts: np.ndarray,
        samples: int,
    ) -> tuple[np.ndarray, np.ndarray, list[tuple[Any, ...]]]:
        """Return the costs of flights, (N,), the states at their ends, (N, n), and each sample."""
        k, n, _ = self._scaled.sizes
        P = self._scaled.P
        calm = np.zeros(self._model.disturbances)
        z = np.pad(starts, [(0, 0), (0, n - k)])
        costs = np.zeros(len(z))
        price = _PRICE * np.einsum("ni,ij,nj->n", z, P, z)[:, None]
        flown = []
        for _ in range(samples):
            u, kept = policy(z[:, :k])
            v = np.clip(u, *self._scaled.input_limits)
            both = np.hstack([z, v])
            pull = 2.0 * both @ self._W
            costs += 0.5 * (both * pull).sum(1)
            z, slopes = self._model.moved_along(z, v, calm)
            z = np.clip(z, -_FARTHEST, _FARTHEST)
            beyond = (z - np.clip(z, *self._limits)) / self._half
            costs += (price * np.abs(beyond)).sum(1)
            push = price * np.sign(beyond) / self._half
            flown.append((kept, slopes, pull, push, u == v))
        return costs + np.einsum("ni,ij,nj->n", z, P, z), z, flown

    def __call__(
        self, network: Network, starts: np.ndarray, samples: int
    ) -> tuple[np.ndarray, list[np.ndarray]]:
        """Return the states at the ends, (N, k), and the gradient by the parameters."""
        k, n, _ = self._scaled.sizes
        P = self._scaled.P
        costs, z, flown = self.flown(network, starts, samples)
        usable = np.isfinite(costs) & (costs > 0.0)
        shares = np.where(usable, 1.0 / np.where(usable, costs, 1.0), 0.0)[:, None] / len(costs)
        pull_z = 2.0 * z @ P * shares
        total = [np.zeros_like(each) for each in network.parameters]
        for kept, slopes, pull, push, is_free in reversed(flown):  # the chain rule from the end
            pull_z = pull_z + push * shares
            by_both = np.einsum("ni,nij->nj", pull_z, slopes) + pull * shares
            gradients, by_z = network.gradients(kept, by_both[:, n:] * is_free)
            pull_z = by_both[:, :n]
            pull_z[:, :k] += by_z
            pull_z = np.clip(np.nan_to_num(pull_z), -_FARTHEST, _FARTHEST)
            size = np.linalg.norm(pull_z, axis=1, keepdims=True)
            pull_z *= _LARGEST / np.maximum(size, _LARGEST)
            for each, gradient in zip(total, gradients, strict=True):
                each += gradient
        return np.where(usable[:, None], z[:, :k], np.inf), total


def taught(
    problem: FlightProblem,
    start: np.ndarray,
    half_widths: np.ndarray,
    seed: int = 0,
    progress: Progress | None = None,
) -> tuple[Network, Predictive]:
    """Return a network taught by the predictive policy, and the teacher.

    The network is fitted to flights of the teacher. Gradient steps through its own flights follow.
    They begin in a box about `start`, and some in the same box about the trim.

    start: center of the initial deviations, (k,)
    half_widths: half-widths of the box, (k,)
    seed: seed of all random numbers
    """
    from controller.game.linear_game import game

    at_end = game(problem.linear, problem.Q, problem.R)
    teacher = policy_of(problem, at_end, margin=TEACHER_MARGIN, estimate="nothing")
    k = len(problem.states)
    of_states = problem.sizes[0][:k]
    rng = np.random.default_rng(seed)
    flights = FlightCosts(teacher)
    lesson = Lesson(teacher, flights, start / of_states, half_widths / of_states, rng)
    states, inputs = lesson.labels()
    end = teacher.controller.nominal_end
    P = teacher.controller.planner.scaled.P[:k, :k]
    sizes = (np.maximum(each, 1e-9) for each in (states.std(axis=0), np.abs(inputs).max(axis=0)))
    network = Network(end.K, P, lesson.level(end.K, P, end.level(P)), *sizes)
    lesson.fit(network, states, inputs)
    lesson.improve(network, progress)
    return network, teacher


def write_policy(network: Network, teacher: Predictive, path: Path) -> Path:
    """Write the network as ONNX and its deployment file beside it, and return the latter's path.

    path: name of the ONNX file
    """
    of_states, of_inputs = teacher.problem.sizes
    path.write_bytes(_onnx_of(network, of_states[: len(network.of_states)], of_inputs))
    deployment = path.with_suffix(".toml")
    write_text(deployment, toml_text(_deployment_tables(teacher, path.name)))
    return deployment


#: The network as an ONNX graph of deviations in the model's units.
_GRAPH = """taught (double[1, {k}] x) => (double[1, {m}] u) {{
  z = Mul(x, nominal)
  y = Mul(z, scale)
  steeper = Mul(y, steep)
  bent = Tanh(steeper)
  features = Concat <axis = 1> (y, bent)
  h1 = MatMul(features, W1)
  a1 = Add(h1, b1)
  f1 = Tanh(a1)
  h2 = MatMul(f1, W2)
  a2 = Add(h2, b2)
  f2 = Tanh(a2)
  h3 = MatMul(f2, W3)
  far = Add(h3, b3)
  Pz = MatMul(z, P)
  products = Mul(Pz, z)
  zPz = MatMul(products, ones)
  exponent = Mul(zPz, level)
  blend = Exp(exponent)
  near = MatMul(z, K)
  difference = Sub(near, far)
  blended = Mul(blend, difference)
  v = Add(far, blended)
  u = Mul(v, size)
}}"""


def _onnx_of(network: Network, of_states: np.ndarray, of_inputs: np.ndarray) -> bytes:
    """Return the network as an ONNX model of deviations in the model's units, (1, k) -> (1, m).

    of_states, of_inputs: nominal values, (k,) and (m,)
    """
    try:
        import onnx
    except ImportError:
        raise missing_package("writing an ONNX file", "onnx") from None
    W1, b1, W2, b2, W3, b3 = network.parameters
    constants = {
        "nominal": 1.0 / of_states[None], "size": of_inputs[None],
        "scale": 1.0 / network.of_states[None], "steep": np.array(_STEEP),
        "P": network.P, "ones": np.ones((len(of_states), 1)), "K": -network.K.T,
        "level": np.array(-1.0 / network.level), "W1": W1, "b1": b1, "W2": W2, "b2": b2,
        "W3": W3 * network.of_inputs, "b3": b3 * network.of_inputs,
    }  # fmt: skip
    graph = onnx.parser.parse_graph(_GRAPH.format(k=len(of_states), m=len(of_inputs)))
    graph.initializer.extend(
        onnx.numpy_helper.from_array(np.asarray(value), name) for name, value in constants.items()
    )
    operators = [onnx.helper.make_opsetid("", 13)]
    model = onnx.helper.make_model(graph, opset_imports=operators, ir_version=8)
    onnx.checker.check_model(model)
    content: bytes = model.SerializeToString()
    return content


def _deployment_tables(teacher: Predictive, network: str) -> dict[str, dict[str, Any]]:
    """Return the tables of the deployment of a network of deviations in the model's units."""
    problem = teacher.problem
    boxes = zip(problem.inputs, *(ends.tolist() for ends in problem.input_limits), strict=True)
    tables: dict[str, dict[str, Any]] = {
        "policy": {"file": network},
        "observation": {name: {"about": "trim"} for name in problem.states},
        "action": {name: {"box": [*box], "map": "trim + a"} for name, *box in boxes},
        "timing": {"dt": teacher.dt},
    }
    if np.count_nonzero(problem.Q - np.diag(np.diag(problem.Q))) == 0:
        Q, R = np.diag(problem.Q).tolist(), np.diag(problem.R).tolist()
        tables["cost"] = {
            "Q": dict(zip(problem.states, Q, strict=True)),
            "R": dict(zip(problem.inputs, R, strict=True)),
        }
    return tables
