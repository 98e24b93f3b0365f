"""Test that the boxes of a proof cover the box of its statement."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from typing import TypeVar

from hfa_proof.checker.reading import Rejected

#: Lowest and highest value of each coordinate of a closed box.
Box = Sequence[tuple[float, float]]
Piece = TypeVar("Piece")


def covering(
    what: str, stated: Box, pieces: Sequence[Piece], box_of: Callable[[Piece], Box]
) -> list[Piece]:
    """Return all pieces of evidence if their boxes cover the stated box.

    what: name of the pieces in a message, such as "the cells"
    stated: box of the claim, (low, high) of each coordinate, with low = high for a claim at one
        value
    pieces: evidence in any order
    box_of: piece -> box, which may overlap other boxes and extend beyond the stated box

    Raises Rejected in these cases:
    - The boxes do not cover the stated box.
    - An endpoint of the stated box or of a piece's box is not finite, or low > high.
    - The stated box has no coordinates.
    - A piece's box and the stated box have different numbers of coordinates.
    """
    _check_ends(f"where {what} are needed", stated, len(stated))
    boxes = [box_of(piece) for piece in pieces]
    for box in boxes:
        _check_ends(what, box, len(stated))
    waiting = [(stated, boxes)]
    while waiting:
        part, all_boxes = waiting.pop()
        near = [box for box in all_boxes if _meets(box, part)]
        if not near:
            raise Rejected(
                f"{what} do not cover {_text(stated)}: nothing is proved at {_text(part)}"
            )
        if not any(_holds(box, part) for box in near):
            waiting += [(half, near) for half in _halves(part, near)]
    return list(pieces)


def _check_ends(what: str, box: Box, coordinates: int) -> None:
    ordered = all(math.isfinite(low) and math.isfinite(high) and low <= high for low, high in box)
    if not (ordered and len(box) == coordinates > 0):
        raise Rejected(
            f"{what}: each coordinate requires one finite interval, low <= high, but {_text(box)} "
            "is given"
        )


def _meets(box: Box, part: Box) -> bool:
    """Return whether a box and a part of the stated box have more in common than a face."""
    for (low, high), (least, most) in zip(box, part, strict=True):
        if least == most and not low <= least <= high:
            return False
        if least < most and not (low < most and high > least):
            return False
    return True


def _holds(box: Box, part: Box) -> bool:
    """Return whether a box contains a part of the stated box."""
    pairs = zip(box, part, strict=True)
    return all(low <= least and most <= high for (low, high), (least, most) in pairs)


def _halves(part: Box, boxes: Sequence[Box]) -> list[Box]:
    """Return the two parts of a box that is cut at an endpoint of another box.

    part: the box that is cut
    boxes: boxes that overlap `part` and do not contain it
    """
    cuts = []
    for i, (least, most) in enumerate(part):
        ends = {end for box in boxes for end in box[i] if least < end < most}
        cuts.append(sorted(ends))
    i = max(range(len(part)), key=lambda coordinate: len(cuts[coordinate]))
    cut = cuts[i][len(cuts[i]) // 2]
    least, most = part[i]
    return [[*part[:i], ends, *part[i + 1 :]] for ends in ((least, cut), (cut, most))]


def _text(box: Box) -> str:
    sides = []
    for low, high in box:
        sides.append(f"{low:.10g}" if low == high else f"{low:.10g} to {high:.10g}")
    return " by ".join(sides) or "nothing"
