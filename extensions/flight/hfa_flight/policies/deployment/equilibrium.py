"""Equilibrium of the sampled loop.

The equilibrium (X, U) satisfies f(X, U) = f(X0, U0) in the linear states and U = command(X, U).
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.matrices import spectral_radius
from hfa_support.reporting.results import Matrix
from trim.linear.kinks import STEP, linearization_at
from trim.point.operating_point import OperatingPoint

_MOST_STEPS = 60
_MOST_HALVES = 30
#: Residual, in nominal rates, below which a point counts as an equilibrium.
_STEADY = 1e-9
#: Residual used where the equations have no finite value.
_FAR_OFF = 1e6
#: Difference of the slopes on both sides above which there is a kink. It is the change of an input
#: over a nominal value, relative to the size of the input.
_SAME_SLOPE = 1e-3
#: A kink keeps more than this share of the difference if the step is divided by `_NEARER`. A smooth
#: function keeps about 1 / _NEARER of it.
_STAYS = 0.5
_NEARER = 8.0
#: Full turn of an angle in each unit, and number of random points at which a turn is tested.
_TURNS = {"rad": 2.0 * np.pi, "deg": 360.0}
_TURNED_POINTS = 8
#: Largest relative difference after a full turn.
_SAME_TURNED = 1e-9


class Frames(NamedTuple):
    """Derivatives of a policy with respect to the observations of several samples.

    K: (m', k), -∂u/∂x, with x the linear states at the present sample.
    K_inputs: (m', m'), ∂u/∂u_before, with u_before the inputs just before that sample.
    past: (m', p), derivatives of u with respect to the earlier observations, the oldest first.
    C: (observations, k), slopes of an observation with respect to the linear states.
    D: (observations, m'), slopes of an observation with respect to the commanded inputs.
    """

    K: np.ndarray
    K_inputs: np.ndarray
    past: np.ndarray
    C: np.ndarray
    D: np.ndarray


@dataclass(frozen=True, eq=False)
class Equilibrium:
    """Equilibrium of the sampled loop and its linearization.

    At a kink, a slope is the mean of those on both sides. u are the commanded inputs, x the linear
    states.

    states: X, (n,). States outside the linear model have their trim values.
    inputs: U, (m,).
    K: (m', k), -∂u/∂x, summed over all samples of the history.
    K_inputs: (m', m'), ∂u/∂u_before, with respect to the previous inputs.
    A: (k, k), of the aircraft.
    B: (k, m'), of the aircraft.
    C: (observations, k), slopes of the observations with respect to the linear states.
    clips: descriptions of saturated actions and inputs.
    clipped_observations: names of the observations that the normalizer clips.
    kinks: notes on entries of A, B, K and K_inputs at a kink.
    basis: (k, r), basis of the coordinates of A, B, C and K, or None for the linear states.
    frames: derivatives with respect to each sample of the history, or None for a single sample.
    """

    states: np.ndarray
    inputs: np.ndarray
    K: Matrix
    K_inputs: np.ndarray
    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    clips: tuple[str, ...] = ()
    clipped_observations: tuple[str, ...] = ()
    kinks: tuple[str, ...] = ()
    basis: Matrix | None = None
    frames: Frames | None = None

    @property
    def gain(self) -> Matrix | None:
        """Gain (I - K_inputs)⁻¹ K of u = -gain x once the commands follow the state, (m', k).

        None for a policy whose inputs do not settle at a constant state, such as an integrator.
        """
        if not spectral_radius(self.K_inputs) < 1.0:
            return None
        return np.linalg.solve(np.eye(len(self.K_inputs)) - self.K_inputs, self.K)

    def in_basis(self, basis: np.ndarray, inverse: np.ndarray) -> Equilibrium:
        """Return the equilibrium with A, B, C and K in the coordinates z of x = basis z.

        basis: (k, r)
        inverse: (r, k), with z = inverse x
        """
        frames = self.frames
        if frames is not None:
            frames = frames._replace(K=frames.K @ basis, C=frames.C @ basis)
        return replace(
            self,
            A=inverse @ self.A @ basis,
            B=inverse @ self.B,
            C=self.C @ basis,
            K=self.K @ basis,
            basis=basis,
            frames=frames,
        )


def whole_turns(deviations: np.ndarray, turns: np.ndarray) -> np.ndarray:
    """Return the whole turns that are nearest to deviations of the linear states, (..., k).

    turns: result of `EquilibriumSearch.turns`, (k,)
    """
    full = np.where(turns > 0.0, turns, 1.0)
    return np.where(turns > 0.0, full * np.round(deviations / full), 0.0)


class EquilibriumSearch:
    """Search for the equilibrium at one trim, in linear states and commanded inputs.

    At the equilibrium, the linear states have the same rates as at a reference trim.

    steady: reference trim, or None for the trim itself.
    """

    def __init__(
        self, deployed: Deployed, point: OperatingPoint, steady: OperatingPoint | None = None
    ) -> None:
        self.deployed = deployed
        self.point = point
        model = point.model
        self.model = model
        self.trim = deployed.trim_vector(point)
        self.rows = model.state_places(model.linear)
        self.columns = model.input_places(deployed.commanded)
        self.base = np.concatenate([point.states, point.inputs])
        self.moving = [*self.rows, *(len(model.states) + column for column in self.columns)]
        rate_scales = [model.rate_scale(name) for name in model.linear]
        input_scales = [model.inputs[name].nominal for name in deployed.commanded]
        state_scales = [model.states[name].nominal for name in model.linear]
        self.residual_scales = np.array([*rate_scales, *input_scales])
        self.scales = np.array([*state_scales, *input_scales])
        at = steady or point
        self.steady = at.model.at(at.states, at.inputs).f[self.rows]

    def from_point(self, states: np.ndarray, inputs: np.ndarray) -> Equilibrium | None:
        """Return the equilibrium found by Newton's method from X (n,) and U (m,), or None.

        If Newton's method fails, a second search begins at the point with the least squared
        residual.
        """
        start = np.concatenate([states, inputs])
        z = self.base.copy()
        z[self.moving] = start[self.moving]
        return self._by_newton(z) or self._by_newton(self._least(z))

    def at_trim(self) -> Equilibrium:
        """Return the linearization at the trim, which need not be an equilibrium."""
        return self._found(self.base)

    def turns(self) -> np.ndarray:
        """Return a full turn for each linear state that is an angle the loop cannot tell from a
        turn more, such as a heading without a heading command, and 0 for the other states, (k,).

        The rates, the observations and the commands at random states must agree after a full turn.
        """
        random = np.random.default_rng(0)
        turns = np.zeros(len(self.rows))
        sizes = np.zeros(len(self.base))
        sizes[self.moving] = self.scales
        points = self.base + sizes * random.uniform(-1.0, 1.0, (_TURNED_POINTS, len(self.base)))
        for number, row in enumerate(self.rows):
            turn = _TURNS.get(self.model.unit(self.model.linear[number]), 0.0)
            turned = points.copy()
            turned[:, row] += turn
            if turn and all(
                np.allclose(self._seen(one), self._seen(other), _SAME_TURNED, _SAME_TURNED)
                for one, other in zip(points, turned, strict=True)
            ):
                turns[number] = turn
        return turns

    def _seen(self, z: np.ndarray) -> np.ndarray:
        """Return the relative rates, the observations and the commands at z = (X, U)."""
        X, U = self._parts(z)
        try:
            rates = np.array([*self.model.rates_at(X.tolist(), U.tolist()).values()])
        except FloatingPointError:
            rates = np.full(len(X), np.nan)
        sizes = [self.model.rate_scale(name) for name in self.model.states]
        seen = [self.deployed.observe(X, U, self.trim), self.deployed.command(X, U, self.trim)]
        return np.concatenate([rates / sizes, *(np.array(part).ravel() for part in seen)])

    def drift(self, equilibrium: Equilibrium) -> np.ndarray:
        """Return the derivatives of the equilibrium with respect to all states, (k, n).

        The derivatives are those of the linear states. The columns of linear states are 0.
        """
        X = equilibrium.states
        U = equilibrium.inputs
        z = np.concatenate([X, U])
        others = [number for number in range(len(X)) if number not in self.rows]
        _, jacobian = self._system(z)
        _, by_states, _ = self.deployed.command_slopes(X, U, self.trim)
        by_others = -np.array(by_states)[np.ix_(self.columns, others)]
        moved = np.vstack([self.model.at(X, U).A[np.ix_(self.rows, others)], by_others])
        scaled = jacobian * self.scales / self.residual_scales[:, None]
        steps = np.linalg.lstsq(scaled, -moved / self.residual_scales[:, None], rcond=1e-12)[0]
        slopes = np.zeros((len(self.rows), len(X)))
        slopes[:, others] = (steps * self.scales[:, None])[: len(self.rows)]
        return slopes

    def lag(self, equilibrium: Equilibrium, drift: np.ndarray) -> np.ndarray:
        """Return the lag (k,) of the linear states behind a moving equilibrium, as in a climb.

        The equilibrium moves with the states outside the linear model. The lag x satisfies
        A x + B u = drift X'.

        drift: result of the method `drift`
        """
        plant = self.model.at(equilibrium.states, equilibrium.inputs)
        count = len(self.columns)
        gain = np.linalg.lstsq(np.eye(count) - equilibrium.K_inputs, equilibrium.K, rcond=None)[0]
        closed = equilibrium.A - equilibrium.B @ gain
        return np.asarray(np.linalg.lstsq(closed, drift @ plant.f, rcond=1e-12)[0])

    def _least(self, z: np.ndarray) -> np.ndarray:
        """Return the point with the least squared residual that a search from z finds."""
        from scipy.optimize import least_squares

        def residuals(steps: np.ndarray) -> np.ndarray:
            residual, _ = self._scaled_system(self._moved(z, steps))
            return np.nan_to_num(residual, nan=_FAR_OFF)

        def slopes(steps: np.ndarray) -> np.ndarray:
            _, jacobian = self._scaled_system(self._moved(z, steps))
            return np.nan_to_num(jacobian)

        start = np.zeros(len(self.moving))
        found = least_squares(residuals, start, jac=slopes, method="lm", max_nfev=200)
        return self._moved(z, found.x)

    def _moved(self, z: np.ndarray, steps: np.ndarray) -> np.ndarray:
        """Return the point after scaled steps of the moving entries."""
        moved = z.copy()
        moved[self.moving] += steps * self.scales
        return moved

    def _scaled_system(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the scaled residual and its Jacobian with respect to scaled steps."""
        residual, jacobian = self._system(z)
        scaled = jacobian * self.scales / self.residual_scales[:, None]
        return residual / self.residual_scales, scaled

    def _by_newton(self, z: np.ndarray) -> Equilibrium | None:
        """Return the equilibrium found by Newton's method with step halving, or None."""
        residual, jacobian = self._scaled_system(z)
        size = _finite_norm(residual)
        for _ in range(_MOST_STEPS):
            if size <= _STEADY * 1e-3 or not (np.isfinite(size) and np.isfinite(jacobian).all()):
                break
            step = np.linalg.lstsq(jacobian, -residual, rcond=1e-12)[0]
            for _ in range(_MOST_HALVES):
                trial = self._moved(z, step)
                following, slopes = self._scaled_system(trial)
                if _finite_norm(following) < size:
                    break
                step = step / 2.0
            else:
                break
            z, residual, jacobian = trial, following, slopes
            size = _finite_norm(residual)
        return self._found(z) if size <= _STEADY else None

    def _parts(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        n = len(self.model.states)
        return z[:n], z[n:]

    def _slopes(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Return the commanded inputs (m',) and their slopes (m', k) and (m', m')."""
        X, U = self._parts(z)
        commanded, by_states, by_inputs = self.deployed.command_slopes(X, U, self.trim)
        u = np.array(commanded).ravel()[self.columns]
        by_linear = np.array(by_states)[np.ix_(self.columns, self.rows)]
        return u, by_linear, np.array(by_inputs)[np.ix_(self.columns, self.columns)]

    def _system(self, z: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the residual (k + m',) of the equilibrium conditions and its Jacobian."""
        X, U = self._parts(z)
        count = len(self.moving)
        try:
            plant = self.model.at(X, U)
        except FloatingPointError:
            return np.full(count, np.nan), np.full((count, count), np.nan)
        u, by_states, by_inputs = self._slopes(z)
        residual = np.concatenate([plant.f[self.rows] - self.steady, U[self.columns] - u])
        A = plant.A[np.ix_(self.rows, self.rows)]
        B = plant.B[np.ix_(self.rows, self.columns)]
        lower = np.hstack([-by_states, np.eye(len(self.columns)) - by_inputs])
        return residual, np.vstack([np.hstack([A, B]), lower])

    def _found(self, z: np.ndarray) -> Equilibrium:
        X, U = self._parts(z)
        plant, kinks = linearization_at(self.model, X, U)
        _, by_states, by_inputs = self._slopes(z)
        slopes, policy_kinks = self._mean_slopes(z, np.hstack([by_states, by_inputs]))
        k = len(self.rows)
        return Equilibrium(
            states=X,
            inputs=U,
            K=-slopes[:, :k],
            K_inputs=slopes[:, k:],
            A=plant.A[np.ix_(self.rows, self.rows)],
            B=plant.B[np.ix_(self.rows, self.columns)],
            C=self._observed_slopes(X, U)[0],
            frames=self._frames(X, U) if self.deployed.past else None,
            clips=self._clips(X, U),
            clipped_observations=self._clipped_observations(X, U),
            kinks=(*self._of_the_loop(kinks), *policy_kinks),
        )

    def _observed_slopes(self, X: np.ndarray, U: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return the slopes C and D of the observations at X and U, as defined in `Frames`."""
        observe = self.deployed.observe
        slopes = observe.jacobian()(X, U, self.trim, observe(X, U, self.trim))
        by_states, by_inputs = (np.nan_to_num(np.array(part)) for part in slopes[:2])
        return by_states[:, self.rows], by_inputs[:, self.columns]

    def _frames(self, X: np.ndarray, U: np.ndarray) -> Frames:
        """Return the derivatives of the policy by the observations of each sample, at X and U."""
        o = np.array(self.deployed.observe(X, U, self.trim)).ravel()
        past = np.tile(o, self.deployed.deployment.history - 1)
        sampled = self.deployed.sampled
        at = (X, U, self.trim, past)
        slopes = sampled.jacobian()(*at, *sampled(*at))
        of_commands = [np.array(part)[self.columns] for part in slopes[: len(at)]]
        by_states, by_inputs, _, by_past = of_commands  # in the order of `at`
        C, D = self._observed_slopes(X, U)
        return Frames(
            K=-by_states[:, self.rows],
            K_inputs=by_inputs[:, self.columns],
            past=by_past,
            C=C,
            D=D,
        )

    def _of_the_loop(self, notes: tuple[str, ...]) -> list[str]:
        """Return the notes that concern entries of A or B in the rows of linear states."""
        linear = self.model.linear
        columns = [("A", name) for name in linear]
        columns += [("B", name) for name in self.deployed.commanded]
        entries = [f"{matrix}({row}, {name})" for row in linear for matrix, name in columns]
        return [note for note in notes if any(entry in note for entry in entries)]

    def _mean_slopes(
        self, z: np.ndarray, derivative: np.ndarray
    ) -> tuple[np.ndarray, tuple[str, ...]]:
        """Return the slopes (m', k + m'), the mean of both sides at kinks, and a note on each."""
        names = (*self.model.linear, *self.deployed.commanded)
        commanded = self.deployed.commanded
        slopes = derivative.copy()
        notes = []
        u = self._slopes(z)[0]
        for column, (row, name) in enumerate(zip(self.moving, names, strict=True)):
            step = STEP * self.scales[column]
            above, below = self._sided_slopes(z, row, step, u)
            nearer_above, nearer_below = self._sided_slopes(z, row, step / _NEARER, u)
            apart = np.abs(above - below) * self.scales[column]
            nearer = np.abs(nearer_above - nearer_below) * self.scales[column]
            allowed = _SAME_SLOPE * (self.residual_scales[len(self.rows) :] + np.abs(u))
            is_kink = (apart > allowed) & (nearer > _STAYS * apart)
            for number in np.flatnonzero(is_kink).tolist():
                slopes[number, column] = (below[number] + above[number]) / 2.0
                notes.append(
                    f"kink of the policy: d {commanded[number]} / d {name} is "
                    f"{below[number] + 0.0:.5g} below and {above[number] + 0.0:.5g} above "
                    "the trim; their mean is used"
                )
        return slopes, tuple(notes)

    def _sided_slopes(
        self, z: np.ndarray, row: int, step: float, u: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the difference quotients of the commands above and below z in one row."""
        moved = np.zeros(len(z))
        moved[row] = step
        above = (self._slopes(z + moved)[0] - u) / step
        below = (u - self._slopes(z - moved)[0]) / step
        return above, below

    def _clips(self, X: np.ndarray, U: np.ndarray) -> tuple[str, ...]:
        """Return descriptions of the actions and inputs that are saturated at given X and U."""
        deployed = self.deployed
        observation = self._observed(X, U)
        _, raw, action = (np.array(part).ravel() for part in deployed.stages(observation))
        low, high = deployed.deployment.box
        words = []
        if not deployed.deployment.actor.squash:
            at_ends = ((raw <= low) | (raw >= high)).tolist()
            for name, is_at_end in zip(deployed.commanded, at_ends, strict=True):
                if is_at_end:
                    words.append(f"the action of {name} at the end of its box")
        unlimited = np.array(deployed.unlimited_inputs(action, X, U, self.trim)).ravel()
        limits = Limits.of(self.model, tuple(self.model.inputs))
        is_limited = limits.at_lowest(unlimited) | limits.at_highest(unlimited)
        for name, column in zip(deployed.commanded, self.columns, strict=True):
            if is_limited[column]:
                words.append(f"{name} at its limit")
        return tuple(words)

    def _clipped_observations(self, X: np.ndarray, U: np.ndarray) -> tuple[str, ...]:
        normalizer = self.deployed.deployment.normalizer
        if normalizer is None:
            return ()
        normal = np.array(self.deployed.stages(self._observed(X, U))[0]).ravel()
        names = [*self.deployed.deployment.observation] * self.deployed.deployment.history
        clipped = np.flatnonzero(np.abs(normal) >= normalizer.clip).tolist()
        return tuple(dict.fromkeys(names[number] for number in clipped))

    def _observed(self, X: np.ndarray, U: np.ndarray) -> np.ndarray:
        """Return the inputs of the policy if X and U are constant over the whole history."""
        o = np.array(self.deployed.observe(X, U, self.trim)).ravel()
        return np.tile(o, self.deployed.deployment.history)


def _finite_norm(values: np.ndarray) -> float:
    """Return the norm of a vector, inf if it is not a finite number."""
    norm = float(np.linalg.norm(values))
    return norm if np.isfinite(norm) else np.inf
