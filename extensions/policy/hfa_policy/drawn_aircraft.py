"""Assessment of a policy on aircraft with random parameters, with the original trim values."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from hfa.options.draws import SEED
from hfa_aircraft.uncertain import spread_of
from hfa_policy.assessment import AssessedPoint, Assessor
from hfa_policy.variations import frozen_at
from verification.drawn import Draws, band_of


def drawn_policy(
    assessor: Assessor,
    assessed: Sequence[AssessedPoint],
    request: Any,
) -> Draws:
    """Return stability and linear cost of the sampled loop on `request.draws` random aircraft.

    An aircraft counts as trimmed if the policy has an equilibrium at every trim. An aircraft counts
    as stable if the sampled loop is also stable at every trim.

    assessed: results on the original aircraft, at each trim
    request: arguments of `hfa assess`
    """
    spread = spread_of(request)
    models = spread.aircraft(request.flown_aircraft(), request.draws, SEED)
    rests = np.ones(len(models), dtype=bool)
    stable = np.ones(len(models), dtype=bool)
    bands = {}
    costs = []
    unsolved = np.zeros(len(models), dtype=bool)
    for point, itself in zip(assessor.points, assessed, strict=True):
        changed = replace(
            assessor,
            deployed=frozen_at(assessor.deployed, point),
            points=tuple(replace(point, model=model, problem=None) for model in models),
            samples=0,
            steady=point,
        )
        loops = changed.sampled_loops()
        radii = np.array([loop.radius for loop in loops])
        rests &= np.isfinite(radii)
        stable &= radii < 1.0
        seen = radii[np.isfinite(radii)].tolist()
        where = f" at {point.title}" if len(assessed) > 1 else ""
        bands[f"spectral radius{where}"] = band_of(itself.radius, seen, "1")
        unsolved |= [math.isfinite(loop.radius) and loop.cost is None for loop in loops]
        costs += [loop.cost.largest for loop in loops if loop.cost is not None]
    has_cost = all(each.cost is not None for each in assessed)
    return Draws(
        len(models),
        SEED,
        tuple(spread.values),
        int(rests.sum()),
        int(stable.sum()),
        max(costs, default=math.nan) if has_cost else None,
        bands,
        int(unsolved.sum()) if has_cost else None,
    )
