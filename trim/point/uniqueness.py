"""States that the equations of a trim do not determine."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from typing import NamedTuple

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.units import si_factor, si_unit
from trim.point.problem import DEPENDENT, TrimProblem
from trim.point.system import TrimSystem


def keepable(system: TrimSystem, set_free: Sequence[str] = ()) -> list[str]:
    """Return the unknowns that a trim may keep at their start values, if the equations do not
    determine them: states, and outputs in their place, that the user did not set free by name.

    set_free: names that were set free, in addition to those of the system's condition
    """
    others = {*system.model.inputs, *system.condition.set_free, *set_free}
    return [name for name in system.equations.unknowns if name not in others]


def is_determined(problem: TrimProblem, z: np.ndarray) -> bool:
    """Return whether the equations determine all unknowns near z, (k,)."""
    return problem.balanced_effects(z).rank == len(z)


class Undetermined(NamedTuple):
    """Unknowns that can change together while the equations remain balanced.

    names: the unknowns, the one that moves farthest for its size first
    to_hold: how many of them must be held for a unique trim
    """

    names: list[str]
    to_hold: int


def undetermined(problem: TrimProblem, z: np.ndarray) -> Undetermined:
    """Return the unknowns that the equations do not determine at a trim.

    z: trim, (k,)
    """
    directions = problem.balanced_effects(z).directions()
    if not len(directions):
        return Undetermined([], 0)
    relative_to_sizes = directions * problem.system.scales / _sizes(problem)
    basis, _ = np.linalg.qr(relative_to_sizes.T)
    movements = np.linalg.norm(basis, axis=1)  # largest part of each unknown in a unit direction
    # Unknowns that move alike to seven digits, as `DEPENDENT`, keep the order of the model.
    order = np.argsort(-np.round(movements, 7), kind="stable")
    names = [problem.free[i] for i in order if movements[i] > DEPENDENT]
    return Undetermined(names, len(directions))


def kept_states(
    problem: TrimProblem, trim_of: Callable[[TrimProblem], np.ndarray | None]
) -> tuple[str, ...]:
    """Return the states that keep their start values, so that the equations determine the trim.

    Of the states that no equation determines, the one that moves farthest for its size is kept,
    until the trim is unique. A state without a trim at its start value is not kept. The result does
    not depend on where the search begins.

    trim_of: problem -> its unknowns at the trim, (k,), or None if there is none
    """
    problem = problem.keeping((), same_start=False)
    points = [problem.clip(problem.system.start)]
    points.append(problem.newton(points[0]))
    while points:
        candidates = _candidates(problem, points)
        points = []
        for name in candidates:
            with suppress(BadInputError):
                tried = problem.keeping((*problem.kept, name))
                found = trim_of(tried)
                if found is not None:
                    problem, points = tried, [found]
                    break
    return problem.kept


def _candidates(problem: TrimProblem, points: list[np.ndarray]) -> list[str]:
    """Return the states that a trim could keep because the equations do not determine them, the one
    that moves farthest for its size first.

    points: scaled unknowns, (k,) each, of which the first with such states decides
    """
    may_be_kept = keepable(problem.system, problem.asked.set_free)
    for z in points:
        with suppress(BadInputError, ArithmeticError):
            names = undetermined(problem, z).names
            if candidates := [name for name in names if name in may_be_kept]:
                return candidates
    return []


def _sizes(problem: TrimProblem) -> np.ndarray:
    """Return the size of each unknown, in its unit, (k,).

    The size of an angle is 1 rad. That of another unknown is the largest start value of all states
    and inputs of its quantity, or its nominal value if they are all 0 or have no unit.
    """
    model, declared = problem.model, problem.system.declared
    largest: dict[str, float] = {}
    for name, value in declared.items():
        unit = model.unit(name)
        quantity = si_unit(unit)
        largest[quantity] = max(largest.get(quantity, 0.0), abs(value) * si_factor(unit))
    sizes = []
    for name in problem.free:
        unit = model.unit(name)
        quantity = si_unit(unit)
        size = 1.0 if quantity == "rad" else largest[quantity]
        has_size = size and quantity != "1"
        sizes.append(size / si_factor(unit) if has_size else model.signals[name].nominal)
    return np.array(sizes)
