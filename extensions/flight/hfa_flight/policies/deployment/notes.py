"""Contradictions between the file of a gain and its deployment file."""

from __future__ import annotations

import math
from collections.abc import Iterator

from hfa_flight.policies.deployment.deployed import Deployed
from hfa_support.units import conversion


def notes_on_files(deployed: Deployed) -> list[str]:
    """Return a sentence for each contradiction between a gain's file and the deployment file.

    The list is empty for a policy that uses earlier samples.
    """
    if deployed.past:
        return []
    deployment = deployed.deployment
    said = deployment.actor.of_gain
    observed = [entry.get("formula", name) for name, entry in deployment.observation.items()]
    notes = []
    for key, table, listed in (
        ("states", "observation", observed),
        ("inputs", "action", [*deployment.action]),
    ):
        of_file = [str(name) for name in said.get(key, ())]
        if of_file and of_file != listed:
            notes.append(
                f"K is a gain of the {key} {', '.join(of_file)}, but [{table}] lists "
                f"{', '.join(listed)}"
            )
    if not notes:
        units = (
            [str(unit) for unit in said.get(key, ())] for key in ("state_units", "input_units")
        )
        notes += _notes_on_units(deployed, observed, *units)
    dt = said.get("dt")
    if dt not in (None, True) and not math.isclose(float(dt), deployment.dt, rel_tol=1e-6):
        notes.append(f"K is a gain for dt = {float(dt):g} s, but timing.dt is {deployment.dt:g} s")
    return notes


def _notes_on_units(
    deployed: Deployed, observed: list[str], units: list[str], units_of_inputs: list[str]
) -> Iterator[str]:
    """Yield a sentence for each observation in another unit than its column of K, and for each
    action without a map in another unit than its row of K.
    """
    entries = deployed.deployment.observation.values()
    for name, entry, unit in zip(observed, entries, units, strict=False):
        if name not in deployed.model.states:
            continue
        own = deployed.model.unit(name)
        expected = conversion(unit, own)
        scale = float(entry.get("scale", 1.0))
        if expected is not None and not math.isclose(scale, expected, rel_tol=1e-3):
            yield (
                f"K is a gain per {unit} of {name}, but the deployment file divides {name} in "
                f"{own} by {scale:g}; scale = {expected:.6g} gives {unit}"
            )
    for (name, entry), unit in zip(
        deployed.deployment.action.items(), units_of_inputs, strict=False
    ):
        own = deployed.model.unit(name)
        factor = conversion(unit, own)
        if "map" not in entry and factor is not None and not math.isclose(factor, 1.0):
            yield (
                f"K is a gain of an action in {unit}, but {name} is in {own}; "
                f'map = "trim + {factor:.6g} * a" converts the action'
            )
