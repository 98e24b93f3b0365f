"""Solve a trim condition: scaled Newton on exact Jacobians, bounded least squares where that is not enough; or say why
there is no solution."""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from hfa_model.aircraft import Aircraft, check_in_range
from hfa_model.atmosphere import density
from hfa_model.vectors import INPUTS, RATE_SCALES, RATE_UNITS, STATES, Input, State
from hfa_support.errors import BadInputError, NoSolutionError
from trim.point.condition import SCALES, VARIABLES, TrimCondition, describe
from trim.point.operating_point import BALANCE, OperatingPoint, Status

#: An entry of the scaled Jacobian up to which a variable does not move an equation.
_NOTHING = 1e-12
#: What the effects of other variables may leave of the effect of one that moves nothing else, relative.
_DEPENDENT = 1e-9


@dataclass(frozen=True)
class TrimProblem:
    """f(X, U) = imposed rates at an aircraft; unknowns in units of `SCALES`, residuals in units of `RATE_SCALES`."""

    aircraft: Aircraft
    condition: TrimCondition

    @property
    def scales(self) -> np.ndarray:
        """One scaled unit of each unknown."""
        return np.array([SCALES[name] for name in self.condition.free])

    @property
    def equations(self) -> tuple[str, ...]:
        """Names of the balanced rates, in order."""
        return tuple(name for name in STATES if name in self.condition.rates)

    def vectors(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """State and input at given unknowns (scaled)."""
        free = dict(zip(self.condition.free, (unknowns * self.scales).tolist(), strict=True))
        values = {**self.condition.imposed, **free}
        values["pitch"] = values["alpha"] + values["gamma"]
        return np.array([values[name] for name in STATES]), np.array([values[name] for name in INPUTS])

    def residual(self, unknowns: np.ndarray) -> np.ndarray:
        """(f - imposed) / scale, one entry an equation."""
        return self._scaled(self.aircraft.rates(*self.vectors(unknowns)))

    def linearization(self, unknowns: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Scaled residual and its Jacobian with respect to the scaled unknowns."""
        value, A, B = self.aircraft.jacobians(*self.vectors(unknowns))
        by_name = {name: A[:, index] for index, name in enumerate(STATES)}
        by_name |= {name: B[:, index] for index, name in enumerate(INPUTS)}
        by_name["gamma"] = by_name["pitch"]
        by_name["alpha"] = by_name["alpha"] + by_name["pitch"]
        rows = [STATES.index(name) for name in self.equations]
        columns = np.column_stack([by_name[name][rows] for name in self.condition.free])
        row_scales = np.array([getattr(RATE_SCALES, name) for name in self.equations])
        return self._scaled(value), columns * self.scales / row_scales[:, None]

    def count(self, guess: np.ndarray) -> tuple[int, int]:
        """Equations that the unknowns can move, and unknowns."""
        jacobian = self.linearization(guess)[1]
        return int(np.count_nonzero(np.abs(jacobian).max(axis=1) > _NOTHING)), len(self.condition.free)

    def limits(self) -> tuple[np.ndarray, np.ndarray]:
        """Lowest and highest scaled unknowns."""
        pairs = np.array([self.condition.limits_of(name) for name in self.condition.free])
        return pairs[:, 0] / self.scales, pairs[:, 1] / self.scales

    def clip(self, unknowns: np.ndarray) -> np.ndarray:
        """The nearest unknowns within the limits."""
        return np.clip(unknowns, *self.limits())

    def inside(self, unknowns: np.ndarray) -> np.ndarray:
        """Which unknowns lie clear of their limits."""
        lowest, highest = self.limits()
        slack = 1e-6 * (1 + np.abs(unknowns))
        return (unknowns > lowest + slack) & (unknowns < highest - slack)

    def solved(self, unknowns: np.ndarray) -> bool:
        """Balanced, and within the limits (a rounding error beyond a limit is within it)."""
        slack = 1e-12 * (1 + np.abs(unknowns))
        lowest, highest = self.limits()
        if not (np.all(unknowns >= lowest - slack) and np.all(unknowns <= highest + slack)):
            return False
        return self.balanced(unknowns) and self.pitch_is_within_limits(unknowns)

    def balanced(self, unknowns: np.ndarray) -> bool:
        """Every residual within `BALANCE`, whatever the limits say."""
        return bool(np.abs(self.residual(unknowns)).max() <= BALANCE)

    def pitch_is_within_limits(self, unknowns: np.ndarray) -> bool:
        """What the limits of alpha and gamma cannot hold when both are free."""
        lowest, highest = self.condition.limits_of("pitch")
        return lowest - 1e-12 <= self.pitch(unknowns) <= highest + 1e-12

    def pitch(self, unknowns: np.ndarray) -> float:
        """θ = α + γ, rad."""
        return float(self.vectors(unknowns)[0][STATES.index("pitch")])

    def first_guess(self, start: OperatingPoint | None) -> np.ndarray:
        """The warm start, or unaccelerated flight of a flat wing: L = W cos γ, T = D + W sin γ, no deflection."""
        return self.unknowns_at(self._flat_wing() if start is None else start.values)

    def unknowns_at(self, values: Mapping[str, float]) -> np.ndarray:
        """The unknowns among the values of all variables."""
        return np.array([values[name] for name in self.condition.free]) / self.scales

    def _flat_wing(self) -> dict[str, float]:
        p, known = self.aircraft.parameters, {**self.condition.begin, **self.condition.imposed}
        guess = dict.fromkeys(VARIABLES, 0.0) | {"speed": SCALES["speed"]} | known
        guess["pitch"] = guess["alpha"] + guess["gamma"]
        check_in_range(State(*(guess[name] for name in STATES)))
        pressure_area = float(density(guess["altitude"])) * guess["speed"] ** 2 / 2 * 3 * p.panel_span * p.chord
        weight = 3 * p.panel_mass * p.gravity
        lift_coefficient = weight * math.cos(guess["gamma"]) / pressure_area
        drag = pressure_area * (p.zero_lift_drag + p.induced_drag * lift_coefficient**2)
        thrust = drag + weight * math.sin(guess["gamma"])
        return guess | {"alpha": lift_coefficient / p.lift_slope, "throttle": thrust / p.thrust_per_throttle}

    def point(self, unknowns: np.ndarray, status: Status) -> OperatingPoint:
        """The operating point at these unknowns."""
        state, control = self.vectors(unknowns)
        unscaled = self.residual(unknowns) * [getattr(RATE_SCALES, name) for name in self.equations]
        residuals = dict(zip(self.equations, unscaled.tolist(), strict=True))
        return OperatingPoint(
            State(*state.tolist()), Input(*control.tolist()), residuals, self.aircraft.variant.name, status
        )

    def failure(self, found: np.ndarray) -> str:
        """One line on the best unknowns found: which equations do not balance within the limits, by how much, which
        limits bind, and, where the equations balance beyond them, what that would take."""
        unknowns = self.clip(found)
        scaled = self.residual(unknowns)
        off = [
            f"{name} by {scaled[i] * getattr(RATE_SCALES, name):.3g} {getattr(RATE_UNITS, name)}"
            for i, name in sorted(enumerate(self.equations), key=lambda item: -abs(scaled[item[0]]))
            if abs(scaled[i]) > BALANCE
        ]
        if not off:
            below, above = (describe("pitch", limit) for limit in self.condition.limits_of("pitch"))
            return (
                f"no trim within limits: pitch would have to be {describe('pitch', self.pitch(unknowns))}, "
                f"it must lie between {below} and {above}"
            )
        can_balance = self.balanced(found)
        binding = self._binding(unknowns, found if can_balance else unknowns)
        why = f"limits that bind: {'; '.join(binding)}" if binding else "no limit binds"
        equations, count = (0, 0) if can_balance else self.count(unknowns)
        if equations > count:
            why += f"; {equations} equations for {count} unknowns, set more free"
        if idle := self._idle(unknowns):
            why += f"; {' and '.join(idle)} moves none of them, set something else free"
        elif not can_balance and (alike := self._alike(unknowns)):
            why += f"; {'; '.join(alike)}; set something else free"
        return f"no trim: these rates do not balance: {', '.join(off)} ({why})"

    def _idle(self, unknowns: np.ndarray) -> list[str]:
        """The free variables that no equation feels: their columns of the Jacobian are 0."""
        felt = np.abs(self.linearization(unknowns)[1]).max(axis=0)
        return [name for name, most in zip(self.condition.free, felt, strict=True) if most <= _NOTHING]

    def _alike(self, unknowns: np.ndarray) -> list[str]:
        """Which free variables move the equations as others do, where fewer directions are left than equations.

        Column by column of the Jacobian: one that is a sum of multiples of those before it adds nothing.
        """
        jacobian = self.linearization(unknowns)[1]
        found: list[str] = []
        kept: list[int] = []
        for column, name in enumerate(self.condition.free):
            before, here = jacobian.take(kept, axis=1), jacobian[:, column]
            shares = np.linalg.lstsq(before, here)[0]
            if np.linalg.norm(here - before @ shares) > _DEPENDENT * np.linalg.norm(here):
                kept.append(column)
                continue
            parts = np.linalg.norm(before, axis=0) * np.abs(shares)
            others = [self.condition.free[kept[i]] for i in np.flatnonzero(parts > _DEPENDENT * parts.max())]
            together = " does" if len(others) == 1 else " do together"
            found.append(f"{name} moves them only as {' and '.join(others)}{together}")
        return found if len(kept) < self.count(unknowns)[0] else []

    def _binding(self, unknowns: np.ndarray, wanted: np.ndarray) -> list[str]:
        """The limits that the unknowns lie at, and what is wanted instead."""
        binding = []
        for name, scale, value, other, *limits in zip(
            self.condition.free, self.scales, unknowns, wanted, *self.limits(), strict=True
        ):
            for limit, word in zip(limits, ("lowest", "highest"), strict=True):
                slack = 1e-6 * (1 + abs(limit))
                if abs(value - limit) <= slack:
                    instead = (
                        f", would have to be {describe(name, other * scale)}" if abs(other - limit) > slack else ""
                    )
                    binding.append(f"{name} at its {word}, {describe(name, limit * scale)}{instead}")
        return binding

    def _scaled(self, value: np.ndarray) -> np.ndarray:
        rates = self.condition.rates
        return np.array(
            [(value[STATES.index(name)] - rates[name]) / getattr(RATE_SCALES, name) for name in self.equations]
        )


_MAX_NEWTON_STEPS = 50
_MAX_HALVINGS = 20
#: Steps to the least effort: to its last digits, and those that are tried before it is known that there is a balance.
_MOST_STEPS, _FEW_STEPS = 500, 100


class TrimError(NoSolutionError):
    """No trim: the message names what does not balance, the limits that bind and what balance would take beyond them;
    `attempt` is the best point within the limits."""

    def __init__(self, message: str, attempt: OperatingPoint) -> None:
        super().__init__(message)
        self.attempt = attempt

    def __reduce__(self) -> tuple[type[TrimError], tuple[str, OperatingPoint]]:
        return TrimError, (str(self), self.attempt)


def find_operating_point(
    aircraft: Aircraft, condition: TrimCondition, start: OperatingPoint | None = None
) -> OperatingPoint:
    """Solve f(X, U) = imposed rates for the free variables, every residual within `BALANCE` of its scale.

    As many equations as unknowns: Newton's method with step halving. More unknowns than equations: the point
    of least control effort Σ (u / scale)², a local minimum near the start. When Newton leaves the limits, or
    with more equations than unknowns: least squares within the limits.

    start: a neighbouring point to begin from (warm start); else an analytic guess. Raises TrimError when the
    equations cannot be balanced within the limits, BadInputError when the condition is not well posed or its
    numbers, with the aircraft's, overflow.
    Source: Stevens, Lewis, Johnson, Aircraft Control and Simulation, Section 3.6.
    """
    if not condition.free:
        raise BadInputError("nothing is free; set at least one of " + ", ".join(VARIABLES) + " free")
    condition = condition.at() if condition.tables else condition
    condition.check_pitch()
    problem = TrimProblem(aircraft, condition)
    try:
        with np.errstate(over="raise"):
            return _solution(problem, problem.clip(problem.first_guess(start)))
    except (ArithmeticError, np.linalg.LinAlgError) as error:
        raise BadInputError(
            "the equations overflow or divide by zero at this condition with these parameters"
            "; take values nearer to an aircraft's"
        ) from error


def beyond_limits(aircraft: Aircraft, condition: TrimCondition, balancing: Mapping[str, float]) -> str:
    """What `find_operating_point` says of a condition that balances beyond the limits only, at these free variables."""
    problem = TrimProblem(aircraft, condition)
    return problem.failure(problem.unknowns_at(balancing))


def _solution(problem: TrimProblem, guess: np.ndarray) -> OperatingPoint:
    equations, unknowns = problem.count(guess)
    search = _least_effort_search if unknowns > equations else _square_search
    found = search(problem, guess)
    best = problem.clip(found)
    if not problem.solved(best):
        raise TrimError(problem.failure(found), problem.point(best, Status.FAILED))
    return problem.point(best, Status.TRIMMED)


def _square_search(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """Newton's solution, or the least-squares one within the limits when Newton leaves them or finds none."""
    best = _newton(problem, guess)
    return best if problem.solved(best) else _newton(problem, _bounded_least_squares(problem, guess))


def _least_effort_search(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    """The solution of least effort; failing that, the point within the limits that comes nearest to balance."""
    best, settled = _least_effort(problem, guess, _FEW_STEPS)
    if settled and problem.solved(best):
        return best
    nearest = _polished(problem, _bounded_least_squares(problem, guess))
    if not problem.solved(nearest):  # then there hardly is a balance, and no use in going on to the last digit
        return best if problem.solved(best) else nearest
    for start in (guess, nearest):
        best, _ = _least_effort(problem, start, _MOST_STEPS)
        if problem.solved(best):
            break
    return best


def _polished(problem: TrimProblem, unknowns: np.ndarray) -> np.ndarray:
    """Newton's method with what lies at a limit staying there."""
    return _newton(problem, unknowns, moving=problem.inside(unknowns))


def _newton(problem: TrimProblem, unknowns: np.ndarray, moving: np.ndarray | None = None) -> np.ndarray:
    """Newton steps (least-norm where the Jacobian is not square), halved until the residual falls.

    moving: which unknowns may move; all of them unless said.
    """
    columns = np.arange(len(unknowns)) if moving is None else np.flatnonzero(moving)
    for _ in range(_MAX_NEWTON_STEPS):
        residual, jacobian = problem.linearization(unknowns)
        norm = float(np.abs(residual).max())
        step = np.zeros(len(unknowns))
        step[columns] = np.linalg.lstsq(jacobian[:, columns], -residual, rcond=1e-12)[0]
        if not np.isfinite(step).all():
            break
        better = _halved(problem, unknowns, step, norm)
        if better is None:
            break
        unknowns = better
    return unknowns


def _halved(problem: TrimProblem, unknowns: np.ndarray, step: np.ndarray, norm: float) -> np.ndarray | None:
    """The longest of step, step/2, ... that lowers the residual; None when none does."""
    for halving in range(_MAX_HALVINGS):
        candidate = unknowns + step / 2**halving
        try:
            if np.abs(problem.residual(candidate)).max() < norm:
                return candidate
        except (BadInputError, FloatingPointError):
            continue  # outside the model: a shorter step stays inside
    return None


def _bounded_least_squares(problem: TrimProblem, guess: np.ndarray) -> np.ndarray:
    from scipy.optimize import least_squares

    lowest, highest = problem.limits()
    inside = np.clip(guess, lowest + 1e-9, highest - 1e-9)
    result = least_squares(
        problem.residual,
        inside,
        jac=lambda unknowns: problem.linearization(unknowns)[1],
        bounds=(lowest, highest),
        xtol=1e-15,
        ftol=1e-15,
        gtol=1e-15,
    )
    return np.asarray(result.x)


def _least_effort(problem: TrimProblem, guess: np.ndarray, most: int) -> tuple[np.ndarray, bool]:
    """min Σ (u_i / scale_i)² over the free inputs, subject to the equations, within the limits; and whether fewer than
    `most` steps led there."""
    from scipy.optimize import minimize

    lowest, highest = problem.limits()
    effort = np.array([name in INPUTS for name in problem.condition.free], dtype=float)
    # Equations that the unknowns cannot move (q = 0 gives θ' = 0) would make the constraints dependent.
    movable = np.abs(problem.linearization(guess)[1]).max(axis=1) > 1e-12
    result = minimize(
        lambda unknowns: float(effort @ unknowns**2),
        guess,
        jac=lambda unknowns: 2 * effort * unknowns,
        method="SLSQP",
        bounds=list(zip(lowest, highest, strict=True)),
        constraints={
            "type": "eq",
            "fun": lambda unknowns: problem.residual(unknowns)[movable],
            "jac": lambda unknowns: problem.linearization(unknowns)[1][movable],
        },
        options={"ftol": 1e-15, "maxiter": most},
    )
    return _polished(problem, problem.clip(np.asarray(result.x))), bool(result.nit < most)
