"""Policy of the state-dependent game: a Riccati equation at each sample.

Source: Cloutier, American Control Conference 1997, 932 (state-dependent Riccati equations).
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Any, Self

import casadi as ca
import numpy as np

from controller.game.linear_game import game
from controller.riccati.gare import solve
from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario
from hfa_flight.plan.held_model import Measured, NearestInputs, wrong_samples_note
from hfa_flight.plan.problem import FlightProblem, flight_problem
from hfa_flight.plan.scaled import ScaledProblem, sample_time_of_plans
from hfa_flight.plan.smooth import smooth_slopes
from hfa_flight.policies.deployment.deployment import Deployment
from hfa_flight.policies.deployment.policy import DeployedPolicy, flown_deployment
from hfa_flight.policies.policy import Measurements, Policy, SampledPolicy
from hfa_support.arguments import ArrayLike
from hfa_support.errors import BadInputError, refuse_unless_positive, shown
from hfa_support.native.bound import BoundFunction
from hfa_support.native.row_code import machine_code
from trim.point.operating_point import OperatingPoint

#: Points of the Gauss quadrature on the ray from the trim to the state.
_QUADRATURE_POINTS = 4
#: Default weight of a kept rate at its limit, relative to the least weight of inputs, in nominal
#: units. It was found on the flexible aircraft: with twice of it, flights at 5 deg cost up to 1.5
#: times the best instead of 1.23 times.
LIMIT_WEIGHT = 10.0
#: Most negative eigenvalue of P, relative to its norm.
_NEGATIVE_BY_ROUNDING = 1e-9


@dataclass(frozen=True, eq=False, repr=False)
class StateDependent(SampledPolicy):
    """Policy v = -R⁻¹ B(z)' P(z) z, saturated at the input limits and kept inside.

      A(z) = ∫ ∂f/∂z(s z, 0) ds over s from 0 to 1,   B(z) = ∂f/∂v(z, 0)
      A'P + P A + Q(z) - P (B R⁻¹ B' - E E'/δ²) P = 0

    Q(z) adds a weight to each rate that is kept inside, proportional to the square of its
    distance from trim over that of its limit. At samples without a solution, P is that of the trim.

    problem: aircraft, trim, weights and limits
    scaled: the policy in nominal units
    """

    plans = True

    problem: FlightProblem
    scaled: RiccatiPolicy

    def reset(self) -> None:
        """Forget the commands and counts of an earlier flight."""
        self.scaled.reset(self.delay)

    def __call__(self, t: float, X: Any) -> np.ndarray:
        """Return the inputs U of the sample at t, absolute, (m,).

        t: s
        X: all states, absolute, (n,) or by name in their order
        """
        return self.problem.inputs_of(self.scaled(self.problem.followed_of(X)))

    @property
    def unsolved(self) -> int:
        """Number of samples since the last reset at which the Riccati equation had no solution."""
        return self.scaled.unsolved

    @property
    def K(self) -> np.ndarray:
        """Gain of v = -K z at the trim, (m, k)."""
        return self.problem.gain_of(self.scaled.gain_at(np.zeros(len(self.problem.followed))))

    def data(self, model: Model) -> dict[str, Any]:
        """Return the JSON data on the policy, with the numbers of samples without a solution, and
        of samples in whose place a prediction was used (`Measured.wrong_count`).
        """
        return {
            **super().data(model),
            "dt": self.dt,
            "unsolved": self.unsolved,
            "wrong_samples": self.scaled.measured.wrong_count,
        }

    def notes(self) -> tuple[str, ...]:
        """Return what the samples of the last flight needed."""
        kept = ", ".join(self.scaled.nearest.states) or "no state"
        lines = [
            f"The game has the {self.problem.weights_text()}.",
            f"One Riccati equation every {self.dt:g} s; kept inside: {kept}.",
        ]
        if self.unsolved:
            lines.append(
                f"At {self.unsolved} samples the game has no solution; P of the trim was used."
            )
        return (*lines, *wrong_samples_note(self.scaled.measured.wrong_count))


class RiccatiPolicy:
    """The policy of the state-dependent game in nominal units.

    `measured` holds the samples of a flight, and `nearest` the inputs that keep the limits of some
    rates, which have the indices `_kept`.

    scaled: the problem in nominal units
    dt: sample time, s
    E: disturbance matrix, (k, p)
    delta: δ, or inf for the LQR
    P: solution at the trim, (k, k)
    limit_weight: weight of a kept rate at its limit, relative to the least eigenvalue of R
    """

    def __init__(
        self,
        scaled: ScaledProblem,
        dt: float,
        E: np.ndarray,
        delta: float,
        P: np.ndarray,
        limit_weight: float,
    ) -> None:
        self.nearest = NearestInputs(scaled, dt)
        self._scaled = scaled
        self._disturbance_term = E @ E.T / delta**2  # of the Riccati equation
        self._P = P
        self._kept = [scaled.problem.states.index(name) for name in self.nearest.states]
        least_weight = float(np.linalg.eigvalsh(scaled.linear_states.R)[0])
        self._limit_weight = limit_weight * least_weight
        nodes, weights = np.polynomial.legendre.leggauss(_QUADRATURE_POINTS)
        #: Points of the ray from the trim to the state, as fractions of it, each with its weight.
        self._ray = list(zip(0.5 * (1.0 + nodes), 0.5 * weights, strict=True))
        self.reset(delay=0.0)

    def __getstate__(self) -> dict[str, Any]:
        """Return the attributes without the compiled function, for copies and pickle."""
        return {name: value for name, value in vars(self).items() if name != "_slopes"}

    @cached_property
    def _slopes(self) -> BoundFunction:
        """Machine code of (z, v) -> the derivatives of the rates by both."""
        return BoundFunction(machine_code(smooth_slopes(self._scaled.problem)))

    def reset(self, delay: float) -> None:
        """Begin a flight.

        delay: time after which inputs act, s
        """
        self.measured = Measured(self.nearest.model, delay)
        self.unsolved = 0

    def __call__(self, z: np.ndarray) -> np.ndarray:
        """Return the inputs (m,) from the measured states z (n,)."""
        # The states of this sample, or their prediction if the sample is wrong.
        z_now = self.measured.checked(z)
        v = np.zeros(self._scaled.counts.inputs)  # trim, while nothing is known about the states
        if z_now is not None:
            z_when_acting = self.measured.when_acting(z_now)  # when v acts, after the delay
            K = self.gain_at(z_when_acting)
            # The first states are those of the linear model; carried ones have no gain.
            of_linear_model = z_when_acting[: K.shape[1]]
            v = np.clip(-K @ of_linear_model, *self._scaled.input_limits)
            v = self.nearest(z_when_acting, v)
        self.measured.command(v)
        return v

    def gain_at(self, z: np.ndarray) -> np.ndarray:
        """Return R⁻¹ B(z)' P(z), (m, k)."""
        R = self._scaled.linear_states.R
        # A(z), the mean of ∂f/∂z on the ray from the trim to z, by Gauss quadrature.
        A = np.sum([weight * self._slopes_at(part * z)[0] for part, weight in self._ray], axis=0)
        _, B = self._slopes_at(z)
        return np.linalg.solve(R, B.T @ self._solution(A, B, self._weights(z), R))

    def _slopes_at(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return ∂f/∂z (k, k) and ∂f/∂v (k, m) at v = 0."""
        k, n, m = self._scaled.counts
        (entries,) = self._slopes.at(np.concatenate([z, np.zeros(m)]))
        slopes = entries.reshape(n + m, n).T[:k]  # CasADi stores the columns one after the other
        return slopes[:, :k], slopes[:, n:]

    def _weights(self, z: np.ndarray) -> np.ndarray:
        """Return Q(z), (k, k): Q with the additional weights of the kept rates."""
        Q = self._scaled.linear_states.Q.copy()
        lowest, highest = self._scaled.state_limits
        for place in self._kept:
            limit = highest[place] if z[place] > 0.0 else lowest[place]
            Q[place, place] += self._limit_weight * (z[place] / limit) ** 2
        return Q

    def _solution(self, A: np.ndarray, B: np.ndarray, Q: np.ndarray, R: np.ndarray) -> np.ndarray:
        """Return P, or that of the trim where the Riccati equation has no solution P >= 0."""
        from scipy.linalg import LinAlgError, schur

        k = len(A)
        S = B @ np.linalg.solve(R, B.T) - self._disturbance_term
        # P maps z to the costate in the stable subspace of the Hamiltonian, which the first k
        # Schur vectors span. P is computed in a unit in which S and Q have the same norm.
        scale = math.sqrt(np.linalg.norm(Q) / np.linalg.norm(S))
        try:
            hamiltonian = np.block([[A, -S * scale], [-Q / scale, -A.T]])
            _, vectors, stable_modes = schur(hamiltonian, sort="lhp")
            P = scale * np.linalg.solve(vectors[:k, :k].T, vectors[k:, :k].T).T
        except LinAlgError:
            stable_modes, P = 0, self._P
        P = 0.5 * (P + P.T)
        least = np.linalg.eigvalsh(P)[0]
        if stable_modes != k or not least >= -_NEGATIVE_BY_ROUNDING * np.linalg.norm(P):
            self.unsolved += 1
            return self._P
        return P


def state_dependent(
    model: Model,
    point: OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    delta: float = math.inf,
    E: ArrayLike | str | None = None,
    dt: float | None = None,
    limit_weight: float = LIMIT_WEIGHT,
    limits: Mapping[str, Any] | None = None,
) -> StateDependent:
    """Return the policy that solves the game of the model at its state, at each sample.

    Its gradient at the trim is the exact gain. It needs no optimizer and no training. The command
    of a sample is changed where a rate would leave its limits. This does not prove that
    a flight converges or stays within the limits.

    model: the aircraft
    point: trim at which flights end
    Q, R: weights, as `hfa.game` accepts them and with its defaults
    delta, E: δ and disturbance matrix of the game, as `hfa.game` accepts them; by default the LQR
    dt: sample time, s, by default chosen from the linear model as for `hfa.predictive`
    limit_weight: weight that is added to a kept rate at its limit, relative to the least eigenvalue
        of R, in nominal units
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope

    Raises BadInputError for a wrong argument. Raises NoSolutionError if the game at the trim has no
    solution, with the least delta that has one.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> point = hfa.trim(model, dihedral=0.2)
    >>> game = hfa.paper.published_game(hfa.linearize(model, point))
    >>> policy = hfa.state_dependent(model, point, game.Q, game.R, delta=game.delta, E=game.E)
    >>> bool(abs(policy.K - hfa.solve(game).K).max() < 1e-8)
    True
    """
    if dt is not None:
        refuse_unless_positive("dt", dt, " s")
    if not 0.0 <= limit_weight < math.inf:
        raise BadInputError(f"limit_weight is {shown(limit_weight)}; give a number of at least 0")
    problem = flight_problem(model, point, Q, R, limits=limits)
    at_trim = game(problem.linear, Q=problem.Q, R=problem.R, delta=delta, E=E)
    scaled = ScaledProblem(problem)
    of_states = problem.nominal.states[: scaled.counts.linear]
    P = np.array(solve(at_trim).P) * np.outer(of_states, of_states)
    step = sample_time_of_plans(scaled, dt)
    scaled_E = np.array(at_trim.E) / of_states[:, None]
    policy = RiccatiPolicy(scaled, step, scaled_E, at_trim.delta, P, limit_weight)
    return StateDependent("state-dependent", problem.point, step, problem, policy)


#: Largest difference of a command and its nearest one that is rounding, in nominal values.
_ROUNDING = 1e-12


@dataclass(frozen=True, eq=False, repr=False)
class KeptInside(Policy):
    """Policy u, replaced during a sample by the nearest inputs that keep the rates' limits.

    Where the next states of the model are within the limits, u is the policy's, to the last bit.

    policy: the policy
    problem: aircraft, trim and limits
    nearest: nearest inputs of a sample that keep the limits
    changed: one entry, the number of samples of the last flight whose command was changed. It is
        counted while the policy flies
    tick: tick of the flight, s, or 0 before the policy has a flight
    delay: time from a sample until its command acts, s
    ticks_per_sample: number of ticks of the flight in a sample
    """

    predicts = False

    policy: Policy
    problem: FlightProblem
    nearest: NearestInputs
    changed: list[int] = field(compare=False)
    tick: float = 0.0
    delay: float = 0.0
    ticks_per_sample: int = 1

    def __post_init__(self) -> None:
        """Hold the inputs of the policy, whether its command is replaced, and by which inputs.

        Raises BadInputError if no state is kept in the samples of a flight.
        """
        if not self.nearest.states:
            raise BadInputError(
                f"in {self.nearest.model.holds[0]:g} s the inputs move no limited state by a tenth "
                "of its range; remove keep-inside"
            )
        size = self.policy.held.shape[1] + 1 + len(self.problem.model.inputs)
        object.__setattr__(self, "held", np.zeros((1, size)))

    def control(self, t: ca.SX, measurements: Measurements, held: ca.SX) -> ca.SX:
        """Return the policy's inputs, or the nearest ones where they differ, (m,).

        held: as `_SamplesInside` returns it
        """
        size = self.policy.held.shape[1]
        of_policy, is_changed, nearest = ca.vertsplit(held, [0, size, size + 1, held.numel()])
        return ca.if_else(is_changed, nearest, self.policy.control(t, measurements, of_policy))

    def sampler(self, initial: np.ndarray | None = None) -> Callable[[int, np.ndarray], np.ndarray]:
        """Return the samples of a new flight, as a function (tick, measured) -> held inputs."""
        self.changed[0] = 0
        return _SamplesInside(self, initial)

    def command(self) -> ca.Function:
        """Return the function (t, measured, held) -> command of the policy, (m,)."""
        problem = self.problem
        t, measured = ca.SX.sym("t"), ca.SX.sym("measured", len(problem.model.states))
        held = ca.SX.sym("held", self.policy.held.shape[1])
        states = measured[problem.model.state_places(problem.model.linear)]
        u = self.policy.control(t, Measurements(states, states), held)
        return ca.Function("command", [t, measured, held], [ca.densify(u)])

    def in_scenario(self, scenario: Scenario) -> tuple[Self, Scenario]:
        """Return the policy with the ticks and the delay of a scenario, and the scenario.

        A deployment's delay is added to that of the scenario, which delays the nearest inputs.
        The policy itself then has no delay: `_SamplesInside` predicts the states for it.

        Raises BadInputError (of the scenario) for a delay of a deployment that is not a whole
        number of samples.
        """
        policy = self.policy
        if isinstance(policy, DeployedPolicy):
            delay = policy.deployed.deployment.delay + scenario.delay
            # The deployment without its delay, in the scenario without one; both act afterwards.
            policy, scenario = policy.prompt().in_scenario(replace(scenario, delay=0.0))
            scenario = replace(scenario, delay=delay)
        else:
            policy, scenario = policy.in_scenario(scenario)
        if isinstance(policy, SampledPolicy):
            policy = replace(policy, delay=0.0)
        nearest = NearestInputs(self.nearest.model.scaled, scenario.interval)
        in_flight = replace(
            self,
            policy=policy,
            nearest=nearest,
            tick=scenario.tick,
            delay=scenario.delay,
            ticks_per_sample=scenario.ticks_per_sample,
        )
        return in_flight, scenario

    def data(self, model: Model) -> dict[str, Any]:
        """Return the data of the policy, the kept states and the number of changed samples."""
        kept = {"kept_inside": list(self.nearest.states), "changed_samples": self.changed[0]}
        return {**self.policy.data(model), **kept}

    def notes(self) -> tuple[str, ...]:
        """Return the notes of the policy, and how often its command was changed."""
        names = ", ".join(self.nearest.states)
        return (
            *self.policy.notes(),
            f"--keep-inside ({names}): the command of {self.changed[0]} samples was changed.",
        )


class _SamplesInside:
    """Samples of one flight of a `KeptInside`.

    A command acts `kept.delay` after its sample. The limits, and a policy that is computed in
    samples, are evaluated at the states at that time, which `_predictor` gives. `_held` are the
    held inputs since the last sample, and zeros before the first one.
    """

    def __init__(self, kept: KeptInside, initial: np.ndarray | None) -> None:
        self._kept = kept
        self._sampler = kept.policy.sampler(initial)  # or None without samples
        self._command = BoundFunction(kept.command())
        self._predictor = Measured(kept.nearest.model, kept.delay)
        self._held = kept.held[0]  # a single row: zeros

    def __call__(self, tick: int, measured: np.ndarray) -> np.ndarray:
        """Return the held inputs of a tick, which change at a sample: those of the policy, 1 if its
        command is replaced or else 0, and the inputs in its place.

        measured: deviations of all states, (n,)
        """
        kept, problem = self._kept, self._kept.problem
        if tick % kept.ticks_per_sample:
            return self._held  # no sample begins
        time = tick * kept.tick
        # Followed states, z, and all states when the command of this sample acts.
        z = self._predictor.when_acting(problem.followed_of(problem.point.x + measured))
        at_action = measured.copy()
        if kept.delay:
            at_action[problem.followed_places] = z * problem.nominal.states

        if self._sampler is None:
            of_policy = kept.policy.held_inputs(tick, time)
        else:
            of_policy = self._sampler(tick, at_action)
        # A policy without samples is evaluated at the states now, as it is without kept limits.
        (u,) = self._command.at(time, measured, of_policy)

        v = u[problem.moved] / problem.nominal.inputs
        inside = kept.nearest(z, v)
        is_changed = bool(np.abs(inside - v).max() > _ROUNDING)
        self._predictor.command(inside)
        kept.changed[0] += is_changed  # number of changed samples
        if is_changed:
            u = problem.inputs_of(inside) - problem.point.u
        self._held = np.concatenate([of_policy, [float(is_changed)], u])
        return self._held


def keep_inside(
    policy: Policy | Deployment,
    model: Model,
    point: OperatingPoint,
    *,
    limits: Mapping[str, Any] | None = None,
) -> KeptInside:
    """Return a policy whose command is changed for a sample where a rate would leave its limits.

    The change is the least, in fractions of the inputs' ranges, after which the model's next states
    are within 96 % of the distances from trim to limits. Only states that the inputs can move by a
    tenth of their range in one sample are kept, such as a pitch rate. Wrong parameters and
    disturbances are not known. In a flight with a delay, the states are predicted over the
    commands under way, for a policy that is computed once a sample too.

    policy: a policy of `hfa.fly`, such as `hfa.predictive(...)`, or an `hfa.Deployment`
    model, point: the aircraft and its trim
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope

    Raises BadInputError if the inputs reach no limit in one sample.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> point = hfa.trim(model, dihedral=0.2)
    >>> planned = hfa.state_dependent(model, point)
    >>> kept = hfa.keep_inside(planned, model, point, limits={"pitch_rate": (-0.05, 0.05)})
    >>> start = {"alpha": 0.05}
    >>> flights = [hfa.fly(model, point, policy, 0.2, initial=start) for policy in (planned, kept)]
    >>> [bool(abs(flight.states[:, 4]).max() <= 0.05) for flight in flights]
    [False, True]
    """
    if isinstance(policy, Deployment):
        policy = flown_deployment(policy, point)
    problem = flight_problem(model, point, limits=limits)
    # A sample is by default that of `Scenario`, s, and in a flight that of its scenario.
    nearest = NearestInputs(ScaledProblem(problem), dt=0.01)
    return KeptInside(
        f"{policy.name}, kept inside",
        policy,
        problem,
        nearest,
        changed=[0],
    )
