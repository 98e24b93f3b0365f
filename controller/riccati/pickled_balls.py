"""Pickling of balls and of their matrices, which FLINT leaves out.

A ball that is restored contains the one that was kept, with the same midpoint and a radius that is
larger by up to the fraction 2^-28: what is proved by the one is proved by the other.
"""

from __future__ import annotations

import copyreg
from collections.abc import Sequence
from functools import cache
from typing import TYPE_CHECKING, Any, TypeAlias

if TYPE_CHECKING:
    from flint import arb, arb_mat

#: Midpoint or radius: m and e of m 2^e, or a text if it is not finite.
_Part: TypeAlias = "tuple[int, int] | str"


@cache
def make_balls_picklable() -> None:
    """Let balls and their matrices be pickled and copied in this process."""
    from flint import arb, arb_mat

    copyreg.pickle(arb, _kept)
    copyreg.pickle(arb_mat, _kept_matrix)


def _kept(ball: arb) -> tuple[Any, ...]:
    """Return the function and its arguments with which pickle restores a ball."""
    return restored_ball, (_part(ball.mid()), _part(ball.rad()))


def _kept_matrix(matrix: arb_mat) -> tuple[Any, ...]:
    """Return the function and its arguments with which pickle restores a matrix of balls."""
    return restored_matrix, (int(matrix.nrows()), int(matrix.ncols()), tuple(matrix.entries()))


def _part(exact: arb) -> _Part:
    """Return the midpoint or the radius of a ball, from a ball of radius 0."""
    if exact.is_finite():
        mantissa, exponent = exact.man_exp()
        return int(mantissa), int(exponent)
    if exact > 0:
        return "inf"
    return "-inf" if exact < 0 else "nan"


def restored_ball(middle: _Part, radius: _Part) -> arb:
    """Return a ball from its parts."""
    from flint import arb

    make_balls_picklable()
    return arb(middle, radius)


def restored_matrix(rows: int, columns: int, entries: Sequence[arb]) -> arb_mat:
    """Return a matrix of balls from its entries, row by row."""
    from flint import arb_mat

    make_balls_picklable()
    return arb_mat(rows, columns, list(entries))
