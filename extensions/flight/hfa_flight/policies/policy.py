"""Policies of a flight as CasADi expressions, with their held inputs."""

from __future__ import annotations

from collections.abc import Callable
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, ClassVar, NamedTuple, Self

import casadi as ca
import numpy as np

from controller.critic.critic import from_functions
from controller.critic.features import symbols_for
from controller.critic.network.declared import NOTHING, Declared
from controller.game.zero_sum import Game
from hfa_aircraft.batch_simulation import saturated
from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_aircraft.servos import positions_of_servos
from hfa_aircraft.waveform import Waveform
from hfa_flight.air.scenario import Scenario
from hfa_flight.air.signals import CommandSteps
from hfa_support.errors import BadInputError, numbers_in, refuse_unknown
from hfa_support.matrices import shape_text
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import storable
from trim.linear.delays import in_samples
from trim.point.operating_point import OperatingPoint

#: Times that differ by less are equal, s.
SAME_TIME = 1e-9


class Measurements(NamedTuple):
    """Measured values that a policy receives, as deviations from trim, with sensor noise.

    error: (k,), x - x_d of the states of the linear model
    states: (k,), x
    """

    error: ca.SX
    states: ca.SX


@dataclass(frozen=True, eq=False, repr=False)
class Policy(Reported):
    """Base class of policies u = control(t, measurements, held).

    name: name in reports
    held: (N, h), inputs of the policy that are constant during a tick: row k during tick k, and the
      last row afterwards
    sizes: numbers of inputs and of states of the linear model, or None if they are those of a trim
    predicts: whether the linear model is flown with the policy too, as a prediction
    """

    predicts: ClassVar[bool] = True

    name: str
    held: np.ndarray = field(default_factory=lambda: np.zeros((1, 0)), kw_only=True)
    sizes: tuple[int, int] | None = field(init=False, repr=False, default=None)

    def refuse_other_sizes(self, point: OperatingPoint) -> None:
        """Raise BadInputError if the policy is for other numbers of inputs or states.

        A policy may see the states without the positions of servos, which are the last ones.
        """
        m, k = len(point.model.inputs), len(point.model.linear)
        if self.sizes in (None, (m, k), (m, k - len(positions_of_servos(point.model)))):
            return
        raise BadInputError(
            f"the policy {self.name} has the size {shape_text(self.sizes or ())}; give {m} x {k}, "
            "inputs x states of the linear model"
        )

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the commanded inputs as deviations from trim, (m,), by default those held."""
        return held

    def held_inputs(self, tick: int, time: float) -> np.ndarray:
        """Return the inputs held from a time in a tick, (h,).

        time: s, for policies that tabulate their inputs over time
        """
        row: np.ndarray = self.held[min(tick, len(self.held) - 1)]
        return row

    def sampler(
        self, initial: np.ndarray | None = None
    ) -> Callable[[int, np.ndarray], np.ndarray] | None:
        """Return the function (tick, measured) -> held inputs (h,) of a sampled policy, or None.

        initial: deviations of the states from the trim at which a flight begins, (n,), if known
        measured: deviations from the trim of what `sensors` measure, with their errors
        """
        return None

    @property
    def sensors(self) -> tuple[str, ...]:
        """What the policy measures in a flight, states and outputs; () for all states, (n,)."""
        return ()

    @property
    def gain(self) -> np.ndarray | None:
        """Gain K (m, k) of u = -K z near the trim, or None if it is not constant."""
        return None

    def sampled_modes(self) -> np.ndarray | None:
        """Return the eigenvalues of the loop of a sampled policy, 1/s, or None if unknown."""
        return None

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy with the timing of a scenario, and the scenario with that of the
        policy.
        """
        return self, scenario

    def tolerates(self) -> str:
        """Return the further delay that the linear loop tolerates, for a first line, or ""."""
        return ""

    def notes(self) -> tuple[str, ...]:
        """Return sentences on the last flight for its report."""
        return ()

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy for the result of a flight."""
        return {"name": self.name}


@dataclass(frozen=True, eq=False, repr=False)
class GainPolicy(Policy):
    """Policy u = -K z + u_d(t), with the measured error z = x - x_d of the states of the linear
    model.

    K: (m, k), or (k,) for one input, held column by column
    feedforward: u_d, (m,), or None for 0
    dt: sample time of a gain of a game in discrete time, s, which flies behind a filter, or None

    Raises BadInputError for another shape or a number that is not finite.
    """

    K: np.ndarray
    feedforward: Waveform | None = None
    dt: float | None = None

    def __post_init__(self) -> None:
        """Raise BadInputError for an invalid gain, and store it in `held`."""
        K = numbers_in("the gain", self.K)
        K = K[None] if K.ndim == 1 else K  # of one input
        if K.ndim != 2 or not K.size or not np.all(np.isfinite(K)):
            raise BadInputError(
                f"the gain has shape {np.shape(self.K)}; give a matrix of finite numbers, "
                "inputs x states"
            )
        fields = {"K": K, "sizes": K.shape, "held": K.ravel("F")[None]}
        for name, value in fields.items():
            object.__setattr__(self, name, value)

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the commanded inputs u = -K z + u_d(t), (m,)."""
        seen = measurements.error[: self.K.shape[1]]
        feedback = -ca.mtimes(ca.reshape(held, *self.K.shape), seen)
        return feedback if self.feedforward is None else feedback + self.feedforward.at(t)

    @property
    def gain(self) -> np.ndarray:
        """Gain K (m, k)."""
        return self.K

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy: name, units of the states, and gain."""
        return {"name": self.name, "state_units": list(model.units(model.linear)), "K": self.K}


@dataclass(frozen=True, eq=False, repr=False)
class FunctionPolicy(Policy):
    """Policy u = sat(π(z), lowest, highest) of a nonlinear critic, such as a network.

    z = x - x_d is the measured error of the states of the linear model.

    function: π as a CasADi Function, z (k,) -> u (m,)
    lowest, highest: (m,), limits of the inputs as deviations from trim
    declared: what the file of the policy states
    """

    function: ca.Function
    lowest: np.ndarray
    highest: np.ndarray
    declared: Declared = NOTHING

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the commanded inputs π(z), (m,), clipped to the limits."""
        return self.limited(measurements.error[: self.function.numel_in(0)])

    def __post_init__(self) -> None:
        """Store the numbers of results and arguments of π in `sizes`."""
        sizes = self.function.numel_out(0), self.function.numel_in(0)
        object.__setattr__(self, "sizes", sizes)

    @cached_property
    def gain(self) -> np.ndarray:
        """Gain K (m, k) at z = 0, that of a critic with this policy, whatever its game."""
        m, k = self.function.numel_out(0), self.function.numel_in(0)
        game = Game(-np.eye(k), np.zeros((k, m)), Q=np.ones(k), R=np.ones(m))
        z = symbols_for([self.function], k)
        return from_functions(game, z, {"policy": self.function(z)}, self.name).K

    @cached_property
    def limited(self) -> ca.Function:
        """Policy u = sat(π(z)) as a CasADi Function z -> u.

        The Function is never inlined, because a network has many operations.
        """
        z = ca.SX.sym("z", self.function.numel_in(0))
        return ca.Function("policy", [z], [self.expression(z)], {"never_inline": True})

    def notes(self) -> tuple[str, ...]:
        """Return what the file of the policy contains and the policy does not use."""
        return self.declared.notes

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy: its name, and what its file states."""
        declared = {} if self.declared is NOTHING else {"declared": storable(self.declared)}
        return {"name": self.name, **declared}

    def expression(self, z: ca.SX) -> ca.SX:
        """Return u = sat(π(z), lowest, highest) as an expression of z, (m,)."""
        u = saturated(self.function(z), ca.DM(self.lowest), ca.DM(self.highest))
        return ca.densify(u)


def function_policy(
    name: str, function: ca.Function, point: OperatingPoint, declared: Declared = NOTHING
) -> FunctionPolicy:
    """Return the policy π(z) about a trim, saturated at the control limits of the model.

    function: π, z (k,) -> u (m,)
    declared: what the file of the policy states
    """
    return FunctionPolicy(name, function, *input_limits(point), declared)


def input_limits(point: OperatingPoint) -> tuple[np.ndarray, np.ndarray]:
    """Return the lowest and highest inputs, (m,), as deviations from a trim."""
    limits = Limits.of(point.model, tuple(point.model.inputs))
    return limits.lowest - point.u, limits.highest - point.u


@dataclass(frozen=True, eq=False, repr=False)
class OpenLoop(Policy):
    """Policy whose inputs are constant between steps.

    held: (1 + S, m), deviations of the inputs from trim, before the first step and after each
    times: (S,), times of the steps, s, increasing
    """

    times: np.ndarray = field(default_factory=lambda: np.zeros(0))

    @property
    def breaks(self) -> np.ndarray:
        """Times of the steps, s."""
        return self.times

    def held_inputs(self, tick: int, time: float) -> np.ndarray:
        """Return the deviations of the inputs from a time on, (m,)."""
        row: np.ndarray = self.held[np.searchsorted(self.times, time + SAME_TIME, side="right")]
        return row


def open_loop(commands: CommandSteps, inputs: tuple[str, ...]) -> OpenLoop:
    """Return the policy that applies commanded steps of inputs, as deviations from trim.

    The steps act at their times and are not filtered.

    inputs: names of all m inputs

    Raises BadInputError if a commanded name is not an input.
    """
    for name in commands.names:
        refuse_unknown("without a law only inputs are commanded; unknown input", name, inputs)
    columns = [inputs.index(name) for name in commands.names]
    held = np.zeros((1 + len(commands.times), len(inputs)))
    held[1:, columns] = commands.values
    return OpenLoop("none", held=held, times=np.asarray(commands.times))


class NextSample(NamedTuple):
    """What a filter knows of the states of the next sample, and a plan in still air does not.

    shift: how far the air along the path moves the states within a sample, (n,)
    deviations: standard deviations of the errors of the predicted states, (n,)
    """

    shift: np.ndarray
    deviations: np.ndarray


@dataclass(frozen=True, eq=False, repr=False)
class SampledPolicy(Policy):
    """Policy U = policy(t, X), computed every dt seconds and held.

    A flight calls `reset` before its first sample.

    point: trim from which deviations are measured
    dt: sample time, s
    tick: tick of the flight, s, or 0 before the policy has a flight: a tick is then a sample
    delay: time from a sample until its command acts, s
    """

    predicts = False
    #: Whether the policy plans on the nonlinear model.
    plans: ClassVar[bool] = False

    point: OperatingPoint
    dt: float
    tick: float = field(default=0.0, kw_only=True)
    delay: float = field(default=0.0, kw_only=True)

    def __post_init__(self) -> None:
        """Hold the inputs of a sample."""
        object.__setattr__(self, "held", np.zeros((1, len(self.point.u))))

    def __copy__(self) -> Self:
        """Return a policy that flies another flight, with its own memory."""
        return deepcopy(self)

    def __call__(self, t: float, X: Any) -> np.ndarray:
        """Return the inputs U (m,) from the time of the sample, s, and all states X (n,).

        X and U are absolute values.
        """
        raise NotImplementedError

    def of_estimate(self, t: float, X: np.ndarray, following: NextSample) -> np.ndarray:
        """Return the inputs U (m,) from an estimate of all states. A policy that estimates states
        itself overrides this, and uses the given estimate unchanged.

        following: what is known of the next sample
        """
        return self(t, X)

    def reset(self) -> None:
        """Forget the samples of an earlier flight."""

    def begin(self, X: Any, following: NextSample | None = None) -> None:
        """Begin a flight. A policy that plans overrides this, and makes its first plan here.

        X: states that are expected at the first sample, absolute, (n,)
        following: as in `of_estimate`, or None without an estimate
        """
        self.reset()

    def _begin_flight(self, initial: np.ndarray | None) -> None:
        """Begin a flight from its initial states, or forget the one before if they are unknown."""
        if initial is None:
            self.reset()
        else:
            self.begin(self.point.x + initial)

    def report(self) -> Report:
        """Return a report of the policy and of what the samples of its last flight needed."""
        return Report(f"Policy: {self.name}", self.notes(), data=self.data(self.point.model))

    def sampler(self, initial: np.ndarray | None = None) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return the function (tick, measured) -> inputs as deviations from trim, (m,).

        A flight begins. The policy is computed at the ticks that are samples.
        """
        self._begin_flight(initial)
        states, inputs = self.point.x, self.point.u
        return self._held_between_samples(
            lambda t, measured: np.asarray(self(t, states + measured)) - inputs
        )

    def _held_between_samples(
        self, computed: Callable[[float, np.ndarray], np.ndarray]
    ) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return (tick, measured) -> the result of `computed(t, measured)` at the last sample."""
        seconds_per_tick = self.tick or self.dt
        ticks_per_sample = round(self.dt / seconds_per_tick)
        held = np.zeros(len(self.point.u))

        def sample(tick: int, measured: np.ndarray) -> np.ndarray:
            nonlocal held
            if tick % ticks_per_sample == 0:
                held = computed(tick * seconds_per_tick, measured)
            return held

        return sample

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy and the scenario with ticks that divide samples and delays.

        Raises BadInputError if the delay is not a whole number of the ticks.
        """
        tick = scenario.tick
        if in_samples(self.dt, tick).rest:  # a sample is not a whole number of these ticks
            tick = self.dt
            if in_samples(scenario.delay, tick).rest:
                raise BadInputError(
                    f"the delay is {scenario.delay:g} s; give a multiple of the sample time "
                    f"{self.dt:g} s, or a tick that divides both"
                )
            scenario = scenario.with_tick(tick, scenario.step)
        return replace(self, tick=tick, delay=scenario.delay), scenario


def deviations_of(point: OperatingPoint, X: Any) -> np.ndarray:
    """Return the states of one sample as deviations from a trim, (n,).

    X: all states, absolute, (n,) or by name in their order

    Raises BadInputError for another number of states, and for rows of several samples.
    """
    states, trim = numbers_in("X", X), point.x
    if states.shape != trim.shape:
        raise BadInputError(
            f"X has shape {states.shape}; give the {len(trim)} states of one sample: "
            f"{', '.join(point.model.states)}"
        )
    return np.asarray(states - trim)
