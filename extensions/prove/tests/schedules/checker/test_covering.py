"""Tests whether boxes cover a stated box, at every point that could be left out."""

from __future__ import annotations

from collections.abc import Sequence
from itertools import pairwise, product

import numpy as np
import pytest

from hfa_prove.check.cover import Box, check_covered
from hfa_prove.fields import Rejected

NAN = float("nan")
INF = float("inf")


def is_covered(stated: Box, boxes: Sequence[Box]) -> bool:
    try:
        check_covered("the boxes", stated, boxes)
    except Rejected:
        return False
    return True


def places(stated: Box, pieces: Sequence[Box]) -> list[tuple[float, ...]]:
    """Return test points in a stated box: all ends of boxes, and a value between each two ends.

    A set of closed boxes that does not cover the stated box omits at least one of these points.
    """
    values = []
    for i, (least, most) in enumerate(stated):
        ends = {least, most} | {end for box in pieces for end in box[i] if least <= end <= most}
        ascending = sorted(ends)
        middles = [(a + b) / 2 for a, b in pairwise(ascending)]
        values.append([*ascending, *middles])
    return list(product(*values))


def contains_point(box: Box, place: Sequence[float]) -> bool:
    return all(low <= value <= high for (low, high), value in zip(box, place, strict=True))


@pytest.mark.parametrize("coordinates", [1, 2, 3])
def test_coverage_agrees_with_coverage_of_test_points(coordinates: int) -> None:
    """Random boxes cover a box exactly if they contain every test point.

    The boxes include single points, duplicates, gaps, overlaps and common ends.
    """
    random = np.random.default_rng(coordinates)
    verdicts = []
    for _ in range(1500 // coordinates):
        largest = int(random.integers(1, 5))

        def box(largest: int = largest) -> list[tuple[float, float]]:
            ends = np.sort(random.integers(0, largest + 1, (coordinates, 2)), axis=1)
            return [(float(low), float(high)) for low, high in ends]

        stated = box()
        pieces = [box() for _ in range(random.integers(0, 7 * coordinates))]
        every_place = places(stated, pieces)
        covered = all(
            any(contains_point(piece, place) for piece in pieces) for place in every_place
        )
        assert is_covered(stated, pieces) is covered, (stated, pieces)
        verdicts.append(covered)
    assert 0.1 < np.mean(verdicts) < 0.9


@pytest.mark.parametrize("stated", [[(1.0, 1.0)], [(0.0, 1.0)], [(0.0, 1.0), (2.0, 2.0)]])
def test_no_evidence_covers_no_statement(stated: Box) -> None:
    """Without evidence no statement is covered, not even one of a single point."""
    assert not is_covered(stated, [])


@pytest.mark.parametrize("end", [NAN, INF, -INF])
def test_infinite_and_nan_ends_are_refused(end: float) -> None:
    """Intervals with an end that is nan or infinite cover no statement and are not covered."""
    for interval in [(end, 1.0), (0.0, end), (end, end)]:
        assert not is_covered([(0.0, 1.0)], [[interval]])
        assert not is_covered([(0.0, 1.0)], [[(0.0, 1.0)], [interval]])
        assert not is_covered([interval], [[(0.0, 1.0)]])
        assert not is_covered([interval], [[interval]])


def test_reversed_ends_and_wrong_dimensions_are_refused() -> None:
    """Reversed ends and wrong numbers of coordinates are refused."""
    assert not is_covered([(1.0, 0.0)], [[(0.0, 1.0)]])
    assert not is_covered([(0.0, 1.0)], [[(1.0, 0.0)]])
    assert not is_covered([(0.0, 1.0)], [[(0.0, 1.0)], [(2.0, -1.0)]])
    assert not is_covered([(0.0, 1.0)], [[(0.0, 1.0), (0.0, 1.0)]])
    assert not is_covered([], [[]])


def test_a_gap_of_one_double_is_detected() -> None:
    """Two intervals with a gap of one double between them do not cover their union.

    The order of intervals has no effect.
    """
    after = float(np.nextafter(0.5, 1.0))
    assert not is_covered([(0.0, 1.0)], [[(0.0, 0.5)], [(after, 1.0)]])
    assert is_covered([(0.0, 1.0)], [[(0.5, 1.0)], [(0.0, 0.5)]])


def test_points_inside_an_interval_do_not_cover_it() -> None:
    """Points inside an interval do not cover the interval."""
    points = [[(value, value)] for value in np.linspace(0.0, 1.0, 11).tolist()]
    assert not is_covered([(0.0, 1.0)], points)
    assert is_covered([(0.5, 0.5)], points)


def test_many_boxes_of_a_bisection_cover_it() -> None:
    """1000 boxes from repeated bisection of a box in four coordinates cover this box.

    If one of the boxes is removed, the others do not cover it.
    """
    random = np.random.default_rng(5)
    boxes: list[list[tuple[float, float]]] = [[(0.0, 1.0)] * 4]
    while len(boxes) < 200:
        box = boxes.pop(int(random.integers(len(boxes))))
        i = int(random.integers(4))
        low, high = box[i]
        for ends in ((low, (low + high) / 2), ((low + high) / 2, high)):
            boxes.append([*box[:i], ends, *box[i + 1 :]])
    whole = [(0.0, 1.0)] * 4
    assert is_covered(whole, boxes)
    del boxes[167]
    assert not is_covered(whole, boxes)
