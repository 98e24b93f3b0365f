"""The search for the weights of a design: scipy.optimize, every evaluation on record."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Callable, Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.jobs.finished import stamp
from hfa_model.provenance import parameter_hash
from hfa_model.support.errors import BadInputError
from hfa_model.support.files import regular_file, write_text
from verification.synthesis.design_evaluation import DesignEvaluation
from verification.synthesis.tuning import Evaluation, Tuned, Tuning


def tune(aircraft: Aircraft, tuning: Tuning, record: Path, progress: Callable[[int, int], None] | None = None) -> Tuned:
    """Differential evolution on the logarithms of the variables, the start among its first members.

    record: a file of every evaluation; a search that was interrupted reads it and goes on where it ended, with the
    same result as without the interruption. BadInputError when it belongs to another search.
    Source: Storn and Price, J. Global Optimization 11 (1997), as implemented in SciPy.
    """
    from scipy.optimize import differential_evolution

    evaluation = DesignEvaluation(aircraft, tuning)
    known = _read_record(record, aircraft, tuning)
    bounds = [(math.log(variable.low), math.log(variable.high)) for variable in tuning.variables]
    first = tuning.first_values()
    seen: list[tuple[np.ndarray, Evaluation]] = []

    def cost(logarithms: np.ndarray) -> float:
        values = np.exp(logarithms)
        key = json.dumps(values.tolist())
        if key not in known:
            known[key] = evaluation.at(values)
            with record.open("a", encoding="utf-8") as file:
                file.write(_line(key, known[key]) + "\n")
        seen.append((values, known[key]))
        if progress is not None:
            progress(min(len(seen), tuning.evaluations), tuning.evaluations)
        return known[key].cost

    members = max(5, min(15 * len(bounds), tuning.evaluations // 8))
    # Half of the first members lie around the start: a good start is worth more than the middle of the limits.
    chance = np.random.default_rng(tuning.seed)
    lows, highs = np.array(bounds).T
    near = np.log(first) + 0.1 * (highs - lows) * chance.standard_normal((members, len(bounds)))
    members_at = np.where(chance.random((members, 1)) < 0.5, near, chance.uniform(lows, highs, near.shape))
    members_at[0] = np.log(first)
    differential_evolution(
        cost,
        bounds,
        init=np.clip(members_at, lows, highs),
        maxiter=max(0, tuning.evaluations // members - 1),
        rng=chance,
        tol=0.0,
        polish=False,
    )
    best = min(seen, key=lambda each: each[1].cost)
    return Tuned(first, seen[0][1], *best, tuple(each for _, each in seen))


def _read_record(path: Path, aircraft: Aircraft, tuning: Tuning) -> dict[str, Evaluation]:
    """Values -> evaluation, of the lines of the file; a new file begins with what decides the results."""
    settings = {**tuning.__dict__, "variables": [variable._asdict() for variable in tuning.variables]}
    for kind in ("cases", "turbulence", "gusts"):
        settings[kind] = [each._asdict() | {"actuator": asdict(each.actuator)} for each in settings[kind]]
    settings["cases"] = [case | {"ends": case["ends"].tolist()} for case in settings["cases"]]
    decides = stamp(settings | {"dynamics": aircraft.variant.name, "parameters": parameter_hash(aircraft.parameters)})
    first = json.dumps(decides)
    lines = regular_file(path).read_text(encoding="utf-8", errors="replace").splitlines() if path.exists() else [first]
    if not lines or lines[0] != first:
        raise BadInputError(f"{path}: this is the record of another search; remove it, or choose another output")
    whole = dict(_whole(lines[1:]))
    kept = [first, *(_line(values, found) for values, found in whole.items())]
    write_text(path, "\n".join(kept) + "\n")
    return whole


def _line(values: str, found: Evaluation) -> str:
    text = json.dumps([json.loads(values), *found])
    return f"{text} {zlib.crc32(text.encode()):08x}"


def _whole(lines: list[str]) -> Iterator[tuple[str, Evaluation]]:
    """What the lines hold, up to the first one that was cut off or damaged: each ends in its checksum."""
    for line in lines:
        text, _, check = line.rpartition(" ")
        if check != f"{zlib.crc32(text.encode()):08x}":
            return
        values, *rest = json.loads(text)
        found: list[Any] = [tuple(each) if isinstance(each, list) else each for each in rest]
        yield json.dumps(values), Evaluation(*found)
