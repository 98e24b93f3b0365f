"""How long a proof on boxes will take, estimated by random descents of its subdivision.

D. E. Knuth, Estimating the efficiency of backtrack programs, Mathematics of Computation 29, 1975.
Nothing that is proved depends on it."""

from __future__ import annotations

import time
from typing import NamedTuple

import numpy as np

from hfa_boxes.check.cover import Question, cube

_DESCENTS = 256
#: Halvings after which a descent ends; no proof of so many boxes is tried.
_DEEPEST = 100


class Forecast(NamedTuple):
    """Expected number of boxes of a proof, and its processor time."""

    boxes: float
    seconds: float


def forecast(question: Question) -> Forecast:
    """Return the expected size of a proof, most often within a factor of 2.

    RefutedError where a descent meets a place at which the answer is no."""
    random = np.random.default_rng(0)
    begin = time.process_time()
    boxes = cube(question.n).part(np.zeros(_DESCENTS, dtype=int))
    seen = 0
    expected = 0.0
    for depth in range(_DEEPEST):
        boxes = boxes.part(~question.is_outside(boxes))
        if not len(boxes.centres):
            break
        seen += len(boxes.centres)
        expected += 2.0**depth * len(boxes.centres) / _DESCENTS
        edges = question.edges(boxes)
        boxes = boxes.part(edges >= 0)
        if not len(boxes.centres):
            break
        count = len(boxes.centres)
        which = np.arange(count) + count * random.integers(0, 2, count)
        boxes = boxes.halves(edges[edges >= 0]).part(which)
    spent = time.process_time() - begin
    return Forecast(expected, expected * spent / max(seen, 1))
