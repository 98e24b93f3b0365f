"""Everything that happens in a flight, what of it is random, and the loop that it makes."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import asdict, dataclass, field, replace
from typing import Any

import numpy as np

from controller.flight.actuators import Actuators
from controller.flight.closed_loop import ClosedLoop
from controller.flight.gusts import Dryden, Gust
from controller.flight.plants import Equations, Plant
from controller.policy.policies import Policy
from controller.policy.signals import CommandedStates, Signal, TimeVector, zero
from hfa_model.aircraft import Aircraft
from hfa_model.parameters import Parameters
from hfa_model.vectors import LINEAR_STATES, STATES
from hfa_support.errors import BadInputError, is_finite, refuse_unknown, refuse_unless_positive, shown
from hfa_support.reporting.fields import Shown
from trim.point.operating_point import OperatingPoint

_N = len(LINEAR_STATES)
#: Streams of random numbers of a member.
_ERRORS, _NOISE, _AIR = range(3)

#: Most steps of a flight: beyond them its rows fill the memory of an ordinary machine.
MOST_STEPS = 10_000_000


@dataclass(frozen=True)
class Uncertainty:
    """What is drawn anew for each member; nothing unless given.

    errors: parameter -> relative standard deviation of the flown aircraft's about the nominal value. noise: state of
    the linear model -> standard deviation of what its sensor adds, drawn anew every tick and held. turbulence:
    (intensity, ft/s, scale, ft) of Dryden turbulence, or None. BadInputError when a
    name or a number is wrong.

    The draws of member k = 0, 1, ... are three independent streams from (seed, k), NumPy's `SeedSequence`: one kind of
    randomness more or less leaves the draws of the others as they are.
    """

    errors: Mapping[str, float] = field(default_factory=dict)
    noise: Mapping[str, float] = field(default_factory=dict)
    turbulence: tuple[float, float] | None = None

    def __post_init__(self) -> None:
        """Name what is wrong before the simulation."""
        for what, given, names in (
            ("parameter", self.errors, Parameters._fields),
            ("noise of state", self.noise, LINEAR_STATES),
        ):
            for name, value in given.items():
                refuse_unknown(f"unknown {what}", name, names)
                if not (is_finite(value) and value >= 0.0):
                    raise BadInputError(
                        f"the standard deviation of {name} is {shown(value)}; it must be a number that is not negative"
                    )
        for value in self.turbulence or ():
            if not (is_finite(value) and value > 0.0):
                raise BadInputError(f"the turbulence has {shown(value)}; intensity and scale must be positive numbers")

    def factors(self, seed: int, member: int) -> np.ndarray:
        """Parameter over nominal, (E,), in the order of `errors`: exp(σ ξ - σ²/2), ξ ~ N(0, 1), σ² = ln(1 + s²).

        Mean 1 and standard deviation s exactly, and never a change of sign.
        """
        sigma = np.sqrt(np.log1p(np.array(list(self.errors.values()), dtype=float) ** 2))
        drawn: np.ndarray = np.exp(sigma * _stream(seed, member, _ERRORS).standard_normal(len(sigma)) - sigma**2 / 2)
        return drawn

    def samples(self, seed: int, member: int, ticks: int) -> np.ndarray | None:
        """Noise N(0, s²) of each tick, (ticks, 6); None without any."""
        levels = np.array([self.noise.get(name, 0.0) for name in LINEAR_STATES])
        if not levels.any():
            return None
        return levels * _stream(seed, member, _NOISE).standard_normal((ticks, len(levels)))

    def air(self, seed: int, member: int, speed: float, tick: float, ticks: int) -> Dryden | None:
        """The turbulence of a member, met at `speed`, ft/s; None when the air is calm."""
        if self.turbulence is None:
            return None
        own_seed = int(_sequence(seed, member, _AIR).generate_state(1, np.uint64)[0])
        return Dryden(*self.turbulence, speed, tick, ticks, own_seed)


def _stream(seed: int, member: int, kind: int) -> np.random.Generator:
    return np.random.default_rng(_sequence(seed, member, kind))


def _sequence(seed: int, member: int, kind: int) -> np.random.SeedSequence:
    return np.random.SeedSequence(seed, spawn_key=(member, kind))


@dataclass(frozen=True, eq=False, repr=False)
class Scenario(Shown):
    """Everything that happens in a flight. All is off unless given.

    duration, step, tick: s; gains, noise samples and turbulence change once a tick, which holds a whole number of
    steps. initial: (7,), deviation from trim. reference, disturbance, noise: (6,) each. errors: parameter -> factor on
    the flown aircraft, which the design does not know. actuators, gust: stages of the loop. uncertainty: what is still
    to be drawn (`drawn`). samples: (ticks, 6), drawn noise, held in each tick. BadInputError when the times do not fit
    each other or the actuators, are too long, an error names no parameter, or there are two gusts.
    """

    duration: float = 20.0
    step: float = 0.001
    tick: float = 0.01
    initial: np.ndarray = field(default_factory=lambda: np.zeros(len(STATES)))
    reference: TimeVector = field(default_factory=lambda: zero(_N))
    disturbance: TimeVector = field(default_factory=lambda: zero(_N))
    noise: TimeVector = field(default_factory=lambda: zero(_N))
    errors: Mapping[str, float] = field(default_factory=dict)
    actuators: Actuators | None = None
    gust: Gust | None = None
    uncertainty: Uncertainty = field(default_factory=Uncertainty)
    samples: np.ndarray | None = None

    def __post_init__(self) -> None:
        """Refuse times that do not fit and errors of nothing."""
        _check_times(self.duration, self.step, self.tick)
        if self.actuators is not None:
            self.actuators.refuse_step(self.step)
        for name, factor in self.errors.items():
            refuse_unknown("unknown parameter", name, Parameters._fields)
            refuse_unless_positive(f"the factor on {name}", factor)
        if self.gust is not None and self.uncertainty.turbulence is not None:
            raise BadInputError("the scenario has a gust and turbulence to be drawn; give one of them")

    @property
    def steps_per_tick(self) -> int:
        """Steps in a tick."""
        return round(self.tick / self.step)

    @property
    def moving_air(self) -> bool:
        """Whether the air moves: a gust, or turbulence that is still to be drawn."""
        return self.gust is not None or self.uncertainty.turbulence is not None

    @property
    def ticks(self) -> int:
        """Ticks in the flight."""
        return round(self.duration / self.tick)

    def drawn(self, seed: int, member: int, speed: float) -> Scenario:
        """One draw of what is uncertain, decided by seed and member alone. speed: at which gusts are met, ft/s."""
        uncertain = self.uncertainty
        factors = zip(uncertain.errors, uncertain.factors(seed, member).tolist(), strict=True)
        return replace(
            self,
            errors={**self.errors, **{name: self.errors.get(name, 1.0) * factor for name, factor in factors}},
            gust=uncertain.air(seed, member, speed, self.tick, self.ticks) or self.gust,
            uncertainty=Uncertainty(),
            samples=uncertain.samples(seed, member, self.ticks),
        )

    def to_dict(self) -> dict[str, Any]:
        """What is known before anything is drawn, for JSON; a signal without a formula is named by its kind."""
        signals = {name: getattr(self, name) for name in ("reference", "disturbance", "noise")}
        formulas = {
            name: each.to_dict() if isinstance(each, (Signal, CommandedStates)) else type(each).__name__
            for name, each in signals.items()
        }
        return {
            "duration": self.duration,
            "step": self.step,
            "tick": self.tick,
            "initial": self.initial,
            "errors": dict(self.errors),
            **formulas,
            "actuators": None if self.actuators is None else asdict(self.actuators),
            "gust": _gust_data(self.gust),
        }


def _gust_data(gust: Any) -> dict[str, Any] | None:
    return None if gust is None else {"kind": type(gust).__name__, **asdict(gust)}


def with_errors(aircraft: Aircraft, scenario: Scenario) -> Equations:
    """The aircraft that is flown: its parameters times the errors of the scenario."""
    wrong = {name: getattr(aircraft.parameters, name) * factor for name, factor in scenario.errors.items()}
    return Equations(aircraft.parameters._replace(**wrong), aircraft.variant)


def loop_of(plant: Plant, policy: Policy, scenario: Scenario, point: OperatingPoint) -> ClosedLoop:
    """The loop of a plant about a point, under a policy, with everything that happens in the scenario."""
    signals = scenario.reference, scenario.disturbance, scenario.noise
    trim = np.array(point.inputs)
    return ClosedLoop(plant, policy, *signals, scenario.gust, scenario.samples, scenario.actuators, trim, scenario.tick)


def _check_times(duration: float, step: float, tick: float) -> None:
    """Raise BadInputError unless all, s, are positive and make `MOST_STEPS` steps at most, the duration whole ticks, a
    tick whole steps."""
    times = {"duration": duration, "step": step, "tick": tick}
    for name, value in times.items():
        refuse_unless_positive(name, value, " s")
    for long, short in (("duration", "tick"), ("tick", "step")):
        count = times[long] / times[short]
        if round(count) < 1 or abs(count - round(count)) > 1e-6 * count:
            raise BadInputError(
                f"{long} is {times[long]:g} s and {short} is {times[short]:g} s; make the {long} a whole number of "
                f"{short}s"
            )
    if duration > MOST_STEPS * step * (1 + 1e-9):
        raise BadInputError(
            f"duration is {duration:g} s; with a step of {step:g} s it must not exceed {MOST_STEPS * step:g} s"
        )
