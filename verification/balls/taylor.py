"""Taylor forms: a function of the dihedral on a whole box, as its polynomial and the range of the next coefficient."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import TYPE_CHECKING

from verification.arithmetic.balls import exact, interval, symmetric

if TYPE_CHECKING:
    from flint import arb, arb_mat, arb_series

#: Corners allow for a remainder this many times as large: whoever checks them may enclose it worse.
_ROOM = 6
#: Coefficients of the polynomial: 1, τ, τ². The remainder is of third order.
ORDER = 3


@dataclass(frozen=True)
class DihedralBox:
    """The dihedral angles from `low` to `high`, degrees, both included; low < high, exact doubles.

    τ = η - middle, degrees, is the variable of every Taylor form on the box.
    """

    low: float
    high: float

    @cached_property
    def middle(self) -> arb:
        """(low + high) / 2, exact."""
        return (exact(self.low) + exact(self.high)) / 2

    @cached_property
    def radius(self) -> arb:
        """(high - low) / 2, exact."""
        return (exact(self.high) - exact(self.low)) / 2

    @cached_property
    def degrees(self) -> arb:
        """The ball of all angles of the box, degrees."""
        return interval(self.low, self.high)

    def halves(self) -> tuple[DihedralBox, DihedralBox]:
        """The box in two, at the double nearest to its middle."""
        cut = float(self.middle)
        return DihedralBox(self.low, cut), DihedralBox(cut, self.high)


def radians(degrees: arb) -> arb:
    """The angle in radians, π enclosed."""
    from flint import arb

    return degrees * arb.pi() / 180


def dihedral_series(degrees: arb, length: int) -> arb_series:
    """η(τ) = degrees + τ, in radians, as a series in τ (degrees) of `length` coefficients."""
    from flint import arb_series

    return arb_series([radians(degrees), radians(exact(1.0))], prec=length)


@dataclass(frozen=True)
class TaylorForm:
    """F(τ) in Σ_{j<k} F_j τ^j + F_k τ^k for |τ| <= radius: matrices of balls.

    coefficients: F_0 .. F_{k-1}, at the middle. last: F_k, the k-th Taylor coefficient at every point of the box
    (Lagrange's remainder, entry by entry).
    """

    coefficients: tuple[arb_mat, ...]
    last: arb_mat
    radius: arb

    def map(self, function: Callable[[arb_mat], arb_mat]) -> TaylorForm:
        """A linear map of the matrix, applied to every coefficient."""
        return TaylorForm(tuple(function(each) for each in self.coefficients), function(self.last), self.radius)

    def __add__(self, other: TaylorForm) -> TaylorForm:
        pairs = zip(self.coefficients, other.coefficients, strict=True)
        return TaylorForm(tuple(a + b for a, b in pairs), self.last + other.last, self.radius)

    def times_affine(self, constant: arb_mat, slope: arb_mat) -> TaylorForm:
        """F(τ) (constant + slope τ): one order higher, brought back into the last coefficient."""
        k = len(self.coefficients)
        terms = [self.coefficients[0] * constant]
        terms += [self.coefficients[j] * constant + self.coefficients[j - 1] * slope for j in range(1, k)]
        over = symmetric(self.radius) * (self.last * slope)
        return TaylorForm(tuple(terms), self.last * constant + self.coefficients[-1] * slope + over, self.radius)

    def range(self) -> arb_mat:
        """Everything that F takes on the box."""
        tau = symmetric(self.radius)
        total = self.last
        for each in reversed(self.coefficients):
            total = each + tau * total
        return total

    def at(self, s: int) -> arb_mat:
        """The polynomial at τ = s radius."""
        return sum(self.moves(s), self.coefficients[0])

    def moves(self, s: int = 1) -> list[arb_mat]:
        """F_1 r, F_2 r²: how far F moves from the middle of the box, but for the rest; r = s radius."""
        return [each * (s * self.radius) ** k for k, each in enumerate(self.coefficients[1:], 1)]

    def corners(self) -> Iterator[arb_mat]:
        """Four matrices whose convex hull holds F(τ) for every |τ| <= r.

        F is affine in (τ, τ²) but for the rest; that curve lies in the hull of (-r, r²), (-r/2, 0), (r/2, 0), (r, r²),
        its Bernstein control points on both halves of the box. What is convex, such as being positive definite, holds
        on the box when it holds at these four.
        """
        constant, slope, bend = self.coefficients
        square = self.radius**2
        rest = _ROOM * symmetric(self.radius) * square * self.last
        for tau, curve in ((1, 1), (0.5, 0), (-0.5, 0), (-1, 1)):
            yield constant + (tau * self.radius) * slope + (curve * square) * bend + rest
