"""The search for the weights of a design, every evaluation on record."""

from __future__ import annotations

import json
import math
import zlib
from collections.abc import Iterator
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np

from hfa_model.aircraft import Aircraft
from hfa_model.provenance import parameter_hash
from hfa_support.errors import BadInputError
from hfa_support.files import regular_file, write_text
from hfa_support.jobs.finished import stamp
from hfa_support.progress import Progress
from verification.synthesis.design_evaluation import DesignEvaluation
from verification.synthesis.tuning import Evaluation, Tuned, Tuning

#: Share of the numbers that a step changes, on average.
CHANGED = 0.3
#: Deviation of their logarithms: at first, at most, and the smallest, from which it returns to `AGAIN`.
FIRST, LARGEST, SMALLEST, AGAIN = 0.5, 1.5, 0.015, 0.25
#: What the deviation is multiplied by after a better design, as is its step, which is taken again; and after others.
GROW, SHRINK = 1.3, 0.97


def tune(aircraft: Aircraft, tuning: Tuning, record: Path, progress: Progress | None = None) -> Tuned:
    """A (1 + 1) evolution strategy: l + σ m z from the best logarithms l so far, m of 0 and 1, z normal.

    The better of two designs is all that it asks for, so that an evaluation ends where it is known to be the worse one.

    record: a file of every evaluation; a search that was interrupted reads it and goes on where it ended, with the
    same result as without the interruption, and so does one that is given more evaluations. BadInputError when it
    belongs to another search.
    Source: Rechenberg, Evolutionsstrategie, 1973.
    """
    evaluation = DesignEvaluation(aircraft, tuning)
    known = _read_record(record, aircraft, tuning)
    seen: list[Evaluation] = []

    def evaluated(values: np.ndarray, below: float) -> Evaluation:
        key = json.dumps(values.tolist())
        if key not in known:
            known[key] = evaluation.at(values, below)
            with record.open("a", encoding="utf-8") as file:
                file.write(_line(key, known[key]) + "\n")
        seen.append(known[key])
        if progress is not None:
            progress(len(seen), tuning.evaluations)
        return known[key]

    chance = np.random.default_rng(tuning.seed)
    lows, highs = np.log([(variable.low, variable.high) for variable in tuning.variables]).T
    first = tuning.first_values()
    best, place, smallest = first, np.log(first), evaluated(first, math.inf)
    deviation, step, better = FIRST, np.zeros(len(first)), False
    while len(seen) < tuning.evaluations:
        if better:
            step, deviation = GROW * step, min(GROW * deviation, LARGEST)
        else:
            changed = chance.random(len(first)) < CHANGED
            changed[chance.integers(len(first))] = True
            step = deviation * changed * chance.standard_normal(len(first))
            deviation = SHRINK * deviation if deviation > SMALLEST else AGAIN
        tried = np.clip(place + step, lows, highs)
        values = np.exp(tried)
        found = evaluated(values, smallest.cost)
        better = found.cost < smallest.cost
        if better:
            best, place, smallest = values, tried, found
    return Tuned(first, seen[0], best, smallest, tuple(seen))


def _read_record(path: Path, aircraft: Aircraft, tuning: Tuning) -> dict[str, Evaluation]:
    """Values -> evaluation, of the lines of the file; a new file begins with what decides the results."""
    settings = {**tuning.__dict__, "variables": [variable._asdict() for variable in tuning.variables]}
    del settings["evaluations"]  # the first of more are the same
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
