"""The flights of Section 5: the two aircraft with their games, control laws and records."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import cached_property, lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

import hfa
from controller import Stack, basis, random_pool
from controller.critic.training_run import TrainingRun
from controller.game.basis import Basis
from controller.reference import feedforward, forcing
from hfa import Game, Solution, solve, verify
from hfa.paper import published_game
from hfa_aircraft.waveform import zero
from hfa_flight import Policy, Scenario, Waveform
from hfa_flight.closed_loop import ClosedLoop, LinearPlant
from hfa_flight.history import Deviations
from hfa_flight.policies.policy import GainPolicy, Measurements
from hfa_flight.simulation import CompiledLoop
from hfa_model import LINEAR_STATES, published_models
from hfa_model.vectors import CONTROL_LIMITS
from hfa_support.errors import refuse_unknown
from studies.section5.configuration import Configuration
from studies.section5.critic_policy import CriticPolicy
from studies.section5.laws.integral_rl import baseline_gain, baseline_weights
from studies.section5.laws.laws import learn, learner_of
from studies.section5.learned_gains import certified_gains
from studies.section5.metrics import Critic, flight_metrics, learning_metrics, residual_at
from trim.hfa.printed import regenerate

#: The two aircraft of Section 5.1: dihedral angle, deg.
CASE_I = 15.0
CASE_II = 5.0
#: Source of A and B: this project's trim and linearization, or the paper's four decimals.
MATRICES = ("regenerated", "printed")
PRINTED = "published, as printed"
MODIFIED = "published, modified"
CERTIFIED = "certified"
CERTIFIED_FF = "certified + feed-forward"
INTEGRAL = "integral RL"
EXACT = "exact"
EXACT_FF = "exact + feed-forward"
REWEIGHTED = "exact, alpha reweighted"
#: Law -> description, for tables and figures.
LAWS = {
    PRINTED: "Eq. (46) with the gains of Theorem 1 and W(0) = 100",
    MODIFIED: "Eq. (46) with a stabilizing start, scaled states and gains by hand",
    CERTIFIED: (
        "u = -K(t) z, the certified law learning in flight; a gentle LQR until K(t) is certified"
    ),
    CERTIFIED_FF: "the same, with the exact feed-forward from the first certified gain on",
    INTEGRAL: "u = -K(t) z, learned in flight by integral RL from the same gentle LQR",
    EXACT: "u = -K z with the exact solution of the game",
    EXACT_FF: "the same with the exact feed-forward: the optimum for this reference",
    REWEIGHTED: "the optimum with feed-forward after the weight of alpha was multiplied",
}
#: Laws of this project. If one of their flights is lost, this is an error of the project and not a
#: finding about the paper.
OWN = (CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, REWEIGHTED)
_N = len(LINEAR_STATES)
#: Function: memory of a law at the ticks, (N, k) -> learned critic.
Learned = Callable[[np.ndarray], Critic]


@dataclass(frozen=True, eq=False, repr=False)
class LearnedGains(GainPolicy):
    """Policy u = -K(t) z + u_d(t), whose feedforward begins with the first certified gain.

    K: the last gain
    gains: gain at each tick, (N, m, n)
    certified_from: time when a learned gain replaces the baseline, s
    tick: s
    """

    gains: np.ndarray = field(kw_only=True)
    certified_from: float = 0.0
    tick: float = 0.0

    def __post_init__(self) -> None:
        """Add to the held inputs of each tick whether the feedforward has begun."""
        super().__post_init__()
        columns = self.gains.transpose(0, 2, 1).reshape(len(self.gains), -1)
        times = self.tick * np.arange(len(self.gains))
        begun = times >= self.certified_from - 1e-9
        object.__setattr__(self, "held", np.column_stack([columns, begun]))

    def control(self, t: ca.SX, measurements: Measurements, memory: ca.SX, held: ca.SX) -> ca.SX:
        """Return the input, (5,)."""
        gains, begun = held[:-1], held[-1]
        u = super().control(t, measurements, memory, gains)
        return u if self.feedforward is None else u - (1.0 - begun) * self.feedforward.at(t)


@dataclass(frozen=True, eq=False)
class PaperCase:
    """One of the two aircraft of Section 5.1, with its game.

    trim_inputs: inputs U0 (5,) of the trim
    """

    dihedral_deg: float
    game: Game
    trim_inputs: np.ndarray

    @property
    def input_limits(self) -> np.ndarray:
        """Assumed lowest and highest deviations of the inputs from the trim, (2, 5).

        The paper states no limits.
        """
        limits: np.ndarray = np.array(CONTROL_LIMITS).T - self.trim_inputs
        return limits

    @cached_property
    def exact(self) -> Solution:
        """The exact solution of the game."""
        return solve(self.game)

    def reweighted(self, alpha_factor: float) -> PaperCase:
        """Return a copy of the case in which the weight of alpha in Q is multiplied by a factor."""
        factors = np.where(np.array(LINEAR_STATES) == "alpha", alpha_factor, 1.0)
        return replace(self, game=replace(self.game, Q=self.game.Q * np.diag(factors)))


@dataclass(frozen=True, eq=False)
class Setting:
    """The configuration and the two aircraft. The first aircraft has a dihedral angle of 15 deg.

    matrices: source of A and B, one of `MATRICES`
    """

    configuration: Configuration
    matrices: str
    cases: tuple[PaperCase, ...]

    def case(self, dihedral_deg: float) -> PaperCase:
        """Return the aircraft of the setting with this dihedral angle, deg."""
        return next(case for case in self.cases if case.dihedral_deg == dihedral_deg)

    @property
    def identity(self) -> dict[str, Any]:
        """Data that determine all results of the study, as plain values."""
        models = [
            {
                "dihedral_deg": case.dihedral_deg,
                "A": case.game.A.tolist(),
                "B": case.game.B.tolist(),
            }
            for case in self.cases
        ]
        return {
            "matrices": self.matrices,
            "models": models,
            "reading": self.configuration.to_dict(),
        }


def make_setting(configuration: Configuration, matrices: str = "regenerated") -> Setting:
    """Return the configuration and both aircraft of the study.

    matrices: "regenerated" for A and B of this project's trims with the published dynamics, or
      "printed" for the paper's A and B

    Raises BadInputError if `matrices` is another word.
    """
    refuse_unknown("unknown matrices", matrices, MATRICES)
    cases = []
    for published in published_models():
        model = regenerate(hfa.aircraft(), published)
        source = published if matrices == "printed" else model
        cases.append(
            PaperCase(
                published.dihedral_deg, published_game(source.A, source.B), model.input_offsets
            )
        )
    return Setting(configuration, matrices, tuple(cases))


@dataclass(frozen=True)
class FlightPlan:
    """Plan of one flight.

    dihedral_deg: dihedral angle of the aircraft, deg
    law: control law
    uncertainty: factor c of the plant's matrix (1 + c) A
    noise: whether the measurement noise of Section 5.4 is added
    commanded: False for a flight from equilibrium under the disturbance alone
    """

    dihedral_deg: float
    law: str
    uncertainty: float = 0.0
    noise: bool = False
    commanded: bool = True

    @property
    def name(self) -> str:
        """Name of the flight, for example "5 deg, certified, A + 0.3 A"."""
        parts = [f"{self.dihedral_deg:g} deg", self.law]
        if self.uncertainty:
            parts.append(f"A {'+' if self.uncertainty > 0 else '-'} {abs(self.uncertainty):g} A")
        if self.noise:
            parts.append("noise")
        if not self.commanded:
            parts.append("disturbance alone")
        return ", ".join(parts)


@dataclass(frozen=True, eq=False)
class FlightRecord:
    """Record of a flight, with one row of the arrays for each tick.

    The arrays end when the flight leaves the envelope.

    times: (N,), s
    states, commands, errors: x, x_d and z, (N, 6)
    inputs: (N, 5)
    critic: the learned critic, or None for a law that does not learn
    residual: Bellman residual of the learned value at the simulated error, (N,), or (0,) if
      `critic` is None
    learned_from: time when a learned gain replaces the baseline, s
    lost_at: time when the flight leaves the envelope, s, or inf
    metrics: metrics of the flight, as `flight_metrics` returns them
    limits: lowest and highest deviations of the inputs that this project assumes, (2, 5)
    """

    plan: FlightPlan
    times: np.ndarray
    states: np.ndarray
    commands: np.ndarray
    errors: np.ndarray
    inputs: np.ndarray
    critic: Critic | None
    residual: np.ndarray
    learned_from: float
    lost_at: float
    metrics: dict[str, Any]
    limits: np.ndarray

    @property
    def held(self) -> bool:
        """True if the flight stayed within the envelope until its end."""
        return bool(np.isinf(self.lost_at))

    def learned_value(self, row: int) -> np.ndarray:
        """Return the learned matrix P, (6, 6), in the row of the record with this number."""
        assert self.critic is not None  # the law learns
        return self.critic.basis.matrix(self.critic.weights[row])


def simulate_plan(setting: Setting, plan: FlightPlan, section: str) -> FlightRecord:
    """Return the record of a flight, simulated under the conditions of a section of the paper."""
    configuration = setting.configuration
    case = setting.case(plan.dihedral_deg)
    reference = configuration.reference if plan.commanded else zero(_N)
    T_w = configuration.predefined_time(section)
    each = configuration.steps_per_tick()
    flown, learned = law_of(setting, case, plan.law, T_w, configuration.frozen(section), reference)
    A, B = (1.0 + plan.uncertainty) * case.game.A, case.game.B
    plant = LinearPlant(A, B, {}, hfa.LinearModel.of(A, B).point)
    noise = configuration.noise if plan.noise else zero(_N)
    settings = configuration.flight
    signals = (reference, configuration.disturbance, noise)
    start = configuration.initial if plan.commanded else np.zeros(_N)
    scenario = Scenario(settings.duration, settings.step, settings.tick, start, *signals)
    flight, lost_at = _simulated(configuration, CompiledLoop(ClosedLoop(plant, flown, scenario)))
    times = flight.times[::each]
    errors = flight.errors[::each]
    # A flight that is lost in its first tick still contains its initial state.
    critic = learned(flight.memory[::each]) if learned is not None else None
    metrics = flight_metrics(configuration, case.game, case.input_limits, flight, lost_at)
    residual = np.zeros(0)
    if critic is not None:
        residual = residual_at(case.game, critic.basis, critic.weights, errors)
        metrics["learning"] = learning_metrics(times, critic, residual, T_w, lost_at)
    return FlightRecord(
        plan=plan,
        times=times,
        states=flight.states[::each],
        commands=reference.sampled(times),
        errors=errors,
        inputs=flight.inputs[::each],
        critic=critic,
        residual=residual,
        learned_from=getattr(flown, "certified_from", 0.0),
        lost_at=lost_at,
        metrics=metrics,
        limits=case.input_limits,
    )


def _simulated(configuration: Configuration, loop: CompiledLoop) -> tuple[Deviations, float]:
    """Return a simulated flight until it leaves the envelope, and the time of leaving, s."""
    limit = configuration.flight.lost_beyond

    def sound_rows(bounded: np.ndarray, memory: np.ndarray) -> np.ndarray:
        rows: np.ndarray = np.all(np.abs(bounded) <= limit, axis=1) & np.all(
            np.isfinite(memory), axis=1
        )
        return rows

    with np.errstate(invalid="ignore", over="ignore"):
        flight = loop.fly(stop=lambda rows: ~sound_rows(rows.states, rows.memory))
        sound = sound_rows(np.hstack([flight.states, flight.inputs]), flight.memory)
    if np.all(sound):
        return flight, np.inf
    lost = int(np.argmin(sound))
    parts: dict[str, Any] = {
        name: value[: max(1, lost)]
        for name, value in vars(flight).items()
        if isinstance(value, np.ndarray)
    }
    return replace(flight, **parts), float(flight.times[lost])


def law_of(
    setting: Setting,
    case: PaperCase,
    law: str,
    predefined_time: float,
    frozen: bool,
    reference: Waveform,
) -> tuple[Policy, Learned | None]:
    """Return the policy of a law, and a function that extracts the learned critic from a flight.

    The function maps the policy's memory in a flight to a `Critic`. For a law that does not learn,
    None is returned in place of the function.

    predefined_time: T_w, s
    frozen: whether learning stops at T_w
    reference: command x_d
    """
    if law in (PRINTED, MODIFIED):
        return _published(setting, case, law, predefined_time, frozen, reference)
    if law in (CERTIFIED, CERTIFIED_FF, INTEGRAL):
        return _learned(setting, case, law, predefined_time, reference)
    tuned = (
        case.reweighted(setting.configuration.reweighted.alpha_factor)
        if law == REWEIGHTED
        else case
    )
    inputs = None if law == EXACT else feedforward(tuned.game, tuned.exact.P, reference).inputs
    return GainPolicy(law, tuned.exact.K, inputs), None


def recorded_pool(setting: Setting, case: PaperCase) -> Stack:
    """Return the random states from which the samples of every critic are selected."""
    critic = setting.configuration.critic
    return random_pool(case.game, critic.pool, critic.seed, np.array(critic.box))


def _published(
    setting: Setting,
    case: PaperCase,
    name: str,
    predefined_time: float,
    frozen: bool,
    reference: Waveform,
) -> tuple[Policy, Learned]:
    """Return the policy that learns by Eq. (46) with recorded samples, as printed or modified."""
    configuration = setting.configuration
    critic = setting.configuration.critic
    chosen: dict[str, Any] = {
        "predefined_time": predefined_time,
        "step": configuration.flight.step,
        "theta": critic.theta,
        "samples": critic.samples,
        "normalisation": critic.normalisation,
    }
    own = configuration.published_as_printed
    if name == MODIFIED:
        own = configuration.published_modified
        chosen |= {"basis": own.basis, "gains": (own.alpha1, own.alpha2)}
    else:
        chosen |= {"basis": critic.basis, "initial_weights": own.initial_weight}
        chosen |= {"recorded_weights": own.initial_weight}
    chosen |= {"coordinates": own.coordinates, "drift": own.drift}
    kind = "modified" if name == MODIFIED else "published"
    pool = recorded_pool(setting, case)
    law = learner_of(case.game, kind, critic.seed, pool=pool, **chosen)
    told = law.settings.drift == "with reference"
    drift = forcing(case.game.A, reference) if told else zero(_N)
    learning = int(np.ceil(predefined_time / configuration.flight.tick - 1e-9))
    ticks = np.arange(learning + 1 if frozen else 1)

    def critic_of(memory: np.ndarray) -> Critic:
        weights = np.array([law.equations.unscaled(row) for row in memory])
        residual = np.array(
            [law.equations.reported_residuals(row)["residual_norm"] for row in memory]
        )
        facts = law.theorem._asdict() | {"alpha1": law.gains[0], "alpha2": law.gains[1]}
        return Critic(
            law.basis, weights, residual, facts | {"explicit_step_limit": law.explicit_step_limit}
        )

    learns = (ticks < learning).astype(float)[:, None]
    return CriticPolicy(name, law, drift, held=learns, start=law.start()["weights"]), critic_of


class _Training(NamedTuple):
    """A training run whose gains are used in the flights of one case."""

    run: TrainingRun  # training run with its weights over time
    gains: np.ndarray  # gain at each tick, (N, m, n)
    certified_from: float  # time when a learned gain replaces the baseline, s
    # whether the last critic passes the checks against the exact solution of the learned problem
    # (game or LQ), and the certified law settles within the predefined time
    certified: bool


@lru_cache(maxsize=4)
def _train(setting: Setting, case: PaperCase, law: str, predefined_time: float) -> _Training:
    """Return the training run of a law for one of the two aircraft."""
    configuration = setting.configuration
    critic = setting.configuration.critic
    target = case.game
    if law == "integral-rl":
        if configuration.irl.form == "lqr":
            target = case.game.with_delta(np.inf)
        chosen = vars(configuration.irl) | {"initial_weights": baseline_weights(case.game)}
        learned = learn(case.game, "integral-rl", critic.seed, **chosen)
    else:
        chosen = {name: getattr(critic, name) for name in ("theta", "basis", "samples")}
        chosen |= {"predefined_time": predefined_time, "tick": configuration.flight.tick}
        chosen |= {"initial_weights": configuration.published_as_printed.initial_weight}
        learned = learn(case.game, law, critic.seed, pool=recorded_pool(setting, case), **chosen)
    gains, certified_from = certified_gains(
        case.game, learned, configuration.flight.tick, baseline_gain(case.game)
    )
    verdict = verify(target, learned)
    assert verdict.table is not None  # of a training run
    in_time = law != "certified" or verdict.table.settling_time <= predefined_time
    return _Training(learned, gains, certified_from, verdict.ok and in_time)


def _learned(
    setting: Setting, case: PaperCase, law: str, predefined_time: float, reference: Waveform
) -> tuple[Policy, Learned]:
    """Return the policy with the gain K(t) of a training run that proceeds during the flight."""
    learner = "integral-rl" if law == INTEGRAL else "certified"
    learned, gains, first, certified = _train(setting, case, learner, predefined_time)
    tick = setting.configuration.flight.tick

    def critic_of(memory: np.ndarray) -> Critic:
        rows = np.searchsorted(learned.time, tick * np.arange(len(memory)) + 1e-9, side="right") - 1
        rows = np.clip(rows, 0, len(learned.time) - 1)
        facts = {"status": learned.outcome, "certified": certified, "learned_from": first}
        facts |= learned.diagnostics
        functions: Basis = basis(learned.basis, _N)
        return Critic(functions, learned.weights[rows], learned.residual_norm[rows], facts)

    inputs = None
    if law == CERTIFIED_FF:
        inputs = feedforward(case.game, case.exact.P, reference).inputs
    return LearnedGains(law, gains[-1], inputs, first, tick, gains=gains), critic_of
