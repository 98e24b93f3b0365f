"""Facts about games that only exact arithmetic decides, in rationals of FLINT.

The entries of a game are doubles, which are rationals. Whether weights are positive semidefinite,
whether a mode is not reached at all, or has no cost at all, are facts on a boundary, which no ball
decides.
"""

from __future__ import annotations

import math
from enum import Enum
from fractions import Fraction
from itertools import pairwise
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.game.zero_sum import Game
from controller.riccati.balls import block_entries
from controller.riccati.equation import pencil_blocks

if TYPE_CHECKING:
    from flint import acb, fmpq, fmpq_mat, fmpq_poly, fmpz_poly


def rational(matrix: np.ndarray) -> fmpq_mat:
    """Return the exact matrix of doubles."""
    from flint import fmpq, fmpq_mat

    fractions = map(Fraction, matrix.ravel().tolist())
    entries = [fmpq(each.numerator, each.denominator) for each in fractions]
    rows, columns = matrix.shape
    return fmpq_mat(rows, columns, entries)


def is_semidefinite(matrix: np.ndarray) -> bool:
    """Return whether the symmetric part of a matrix of doubles is positive semidefinite.

    By the decomposition L D L' with pivots that are not 0.
    """
    exact = rational(matrix)
    rows = ((exact + exact.transpose()) / 2).tolist()
    left = set(range(len(rows)))
    while left:
        if any(rows[i][i] < 0 for i in left):
            return False
        pivot = next((i for i in left if rows[i][i] != 0), None)
        if pivot is None:
            return all(rows[i][j] == 0 for i in left for j in left)
        left.remove(pivot)
        for i in left:
            factor = rows[i][pivot] / rows[pivot][pivot]
            if factor != 0:
                for j in left:
                    rows[i][j] -= factor * rows[pivot][j]
    return True


def unreachable_modes(A: fmpq_mat, B: fmpq_mat) -> fmpz_poly | None:
    """Return the characteristic polynomial of the modes of A that B does not reach, None for none.

    A: (n, n)
    B: (n, m)
    """
    from flint import fmpq_mat

    n = A.nrows()
    reached, columns = B, B
    rank = reached.rank()
    for _ in range(n):
        columns = A * columns
        both = [
            [*left, *right] for left, right in zip(reached.tolist(), columns.tolist(), strict=True)
        ]
        further = fmpq_mat(both)
        if further.rank() == rank:
            break
        reached, rank = _columns(further), further.rank()
    if rank == n:
        return None
    # The rows L with L B = L A B = ... = 0 span an invariant subspace: L A = F L.
    basis = null_space(reached.transpose())
    left = basis.transpose()
    _, pivots = echelon(left)
    square = fmpq_mat([[left[i, j] for j in pivots] for i in range(left.nrows())])
    moved = left * A
    of_modes = fmpq_mat([[moved[i, j] for j in pivots] for i in range(left.nrows())]) * square.inv()
    return of_modes.charpoly().numer()


def echelon(matrix: fmpq_mat) -> tuple[fmpq_mat, list[int]]:
    """Return the reduced row echelon form, and the columns of its pivots."""
    reduced, rank = matrix.rref()
    rows = reduced.tolist()[: int(rank)]
    return reduced, [next(j for j, entry in enumerate(row) if entry != 0) for row in rows]


def _columns(matrix: fmpq_mat) -> fmpq_mat:
    """Return independent columns that span the same space."""
    from flint import fmpq_mat

    _, pivots = echelon(matrix)
    return fmpq_mat([[row[j] for j in pivots] for row in matrix.tolist()])


def null_space(matrix: fmpq_mat) -> fmpq_mat:
    """Return a basis of the vectors v with M v = 0, in columns, (n, n - rank)."""
    from flint import fmpq_mat

    reduced, pivots = echelon(matrix)
    free = [j for j in range(matrix.ncols()) if j not in pivots]
    basis = fmpq_mat(matrix.ncols(), len(free))
    for place, j in enumerate(free):
        basis[j, place] = 1
        for i, pivot in enumerate(pivots):
            basis[pivot, place] = -reduced[i, j]
    return basis


def unstable_root(polynomial: fmpz_poly, growth: float, *, is_discrete: bool) -> complex | None:
    """Return a root that is proved not to be stable, the one with the largest growth, or None.

    growth: factor of the roots in discrete time, before they are compared with 1; 1 to decide on
        the boundary, too
    """
    unstable = []
    for root in _roots(polynomial):
        size = abs(root) * growth - 1 if is_discrete else root.real
        if size > 0:
            unstable.append((float(size.mid()), complex(root)))
    if unstable:
        return max(unstable, key=lambda each: each[0])[1]
    return boundary_root(polynomial, is_discrete=is_discrete) if growth == 1.0 else None


def _roots(polynomial: fmpz_poly) -> list[acb]:
    """Return the roots, isolated in balls."""
    pairs: Any = polynomial.complex_roots()
    return [root for root, _ in pairs]


def boundary_root(polynomial: fmpz_poly, *, is_discrete: bool) -> complex | None:
    """Return a root on the boundary of stability, which is proved to have one, or None."""
    from flint import fmpq, fmpq_poly

    coefficients = polynomial.coeffs()
    mirrored = coefficients[::-1]
    if not is_discrete:
        mirrored = [entry * (-1) ** power for power, entry in enumerate(coefficients)]
    product = fmpq_poly(coefficients) * fmpq_poly(mirrored)
    exists = has_root_on_circle(product, fmpq(1)) if is_discrete else has_root_on_axis(product)
    if not exists:
        return None
    roots = _roots(polynomial)
    sizes = [abs(root) - 1 if is_discrete else root.real for root in roots]
    value = complex(roots[min(range(len(roots)), key=lambda i: abs(float(sizes[i].mid())))])
    return value if is_discrete else complex(0.0, value.imag)


def has_root_on_axis(even: fmpq_poly) -> bool:
    """Return whether an even polynomial in s has a root on the imaginary axis."""
    from flint import fmpq, fmpq_poly

    in_square = fmpq_poly(list(even.coeffs())[::2])
    return bool(in_square[0] == 0) or _real_roots(in_square, None, fmpq(0)) > 0


def has_root_on_circle(polynomial: fmpq_poly, square: fmpq) -> bool:
    """Return whether t^n h(t + 1 / (square t)) has a root t with |t|² square = 1.

    There, t + 1 / (square t) is real, and its square is at most 4 / square.
    """
    from flint import fmpq, fmpq_poly

    coefficients = polynomial.coeffs()
    while coefficients[0] == 0:  # roots at 0 and infinity
        coefficients = coefficients[1:]
    n = (len(coefficients) - 1) // 2
    powers = [fmpq_poly([2]), fmpq_poly([0, 1])]  # t^k + 1 / (square t)^k
    while len(powers) <= n:
        powers.append(powers[1] * powers[-1] - powers[-2] / square)
    h = fmpq_poly([coefficients[n]])
    for k in range(1, n + 1):
        h = h + powers[k] * coefficients[n + k]
    if h.gcd(fmpq_poly([-4, 0, square])).degree() > 0:
        return True
    bits = 1 << 300
    inside = fmpq(math.isqrt(int((4 / square * bits * bits).floor())), bits)  # below 2 / √square
    return _real_roots(h, -inside, inside) > 0


def _real_roots(polynomial: fmpq_poly, low: fmpq | None, high: fmpq) -> int:
    """Return the number of real roots in (low, high], by Sturm's theorem; None for -inf."""
    if polynomial.degree() < 1:
        return 0
    sequence = [polynomial, polynomial.derivative()]
    while sequence[-1].degree() > 0:
        rest = sequence[-2] % sequence[-1]
        if rest.degree() < 0:
            break
        sequence.append(-rest / abs(rest[rest.degree()]))

    def changes(point: fmpq | None) -> int:
        if point is None:
            values = [each[each.degree()] * (-1) ** (each.degree() % 2) for each in sequence]
        else:
            values = [each(point) for each in sequence]
        signs = [value > 0 for value in values if value != 0]
        return sum(a != b for a, b in pairwise(signs))

    return changes(low) - changes(high)


def rational_root(value: float) -> fmpq | None:
    """Return the root of a double if it is rational, or None."""
    from flint import fmpq

    fraction = Fraction(value)
    above, below = math.isqrt(fraction.numerator), math.isqrt(fraction.denominator)
    is_exact = above**2 == fraction.numerator and below**2 == fraction.denominator
    return fmpq(above, below) if is_exact else None


class Boundary(Enum):
    """Where a pencil has eigenvalues."""

    SINGULAR = "singular at every number"
    CROSSED = "on the boundary of stability"
    CLEAR = "not on it"


def boundary_of(game: Game, delta: float) -> Boundary:
    """Return whether the Hamiltonian of a game has an eigenvalue exactly on the axis, in discrete
    time its pencil on the circle.
    """
    from flint import fmpq

    A, B, E, Q, R, N = (rational(each) for each in (game.A, game.B, game.E, game.Q, game.R, game.N))
    Q, R = (Q + Q.transpose()) / 2, (R + R.transpose()) / 2
    is_disturbed = math.isfinite(delta)
    price = exact_fraction(delta) ** 2 if is_disturbed else fmpq(1)
    if not game.is_discrete:
        S = B * R.solve(B.transpose())
        if is_disturbed:
            S = S - E * E.transpose() / price
        free, cost = A - B * R.solve(N.transpose()), Q - N * R.solve(N.transpose())
        H = stacked_rationals([[free, S * -1], [cost * -1, free.transpose() * -1]])
        return Boundary.CROSSED if has_root_on_axis(H.charpoly()) else Boundary.CLEAR
    n, m, k = A.nrows(), B.ncols(), E.ncols() if is_disturbed else 0
    growth = exact_fraction(game.discount)
    G = stacked_rationals([[B, E]]) if is_disturbed else B
    C = stacked_rationals([[N, _zeros(n, k)]])
    W = stacked_rationals([[R, _zeros(m, k)], [_zeros(k, m), rational(-np.eye(k)) * price]])
    # The eigenvalues of √growth A are √growth z.
    blocks = pencil_blocks(A, G, Q, W, C, rational(np.eye(n)), growth)
    L, M = map(stacked_rationals, blocks)
    points = list(range(-n, n + 1))
    polynomial = _through(points, [(L - M * point).det() for point in points])
    if polynomial.degree() < 0:
        return Boundary.SINGULAR
    return Boundary.CROSSED if has_root_on_circle(polynomial, growth) else Boundary.CLEAR


def exact_fraction(value: float) -> fmpq:
    """Return a double as the rational that it is."""
    from flint import fmpq

    fraction = Fraction(value)
    return fmpq(fraction.numerator, fraction.denominator)


def _through(points: list[int], values: list[fmpq]) -> fmpq_poly:
    """Return the polynomial with these values (Newton)."""
    from flint import fmpq_poly

    differences = list(values)
    for order in range(1, len(points)):
        for i in reversed(range(order, len(points))):
            step = points[i] - points[i - order]
            differences[i] = (differences[i] - differences[i - 1]) / step
    polynomial = fmpq_poly([differences[-1]])
    for point, value in zip(reversed(points[:-1]), reversed(differences[:-1]), strict=True):
        polynomial = polynomial * fmpq_poly([-point, 1]) + fmpq_poly([value])
    return polynomial


def stacked_rationals(blocks: list[list[fmpq_mat]]) -> fmpq_mat:
    """Return the matrix [[a, b], [c, d]] of blocks a, b, c and d."""
    from flint import fmpq_mat

    return fmpq_mat(block_entries(blocks))


def _zeros(rows: int, columns: int) -> fmpq_mat:
    from flint import fmpq_mat

    return fmpq_mat(rows, columns)


def costs_nothing(game: Game) -> bool:
    """Return whether the disturbance moves only stable states without cost, for u = -R⁻¹N' z.

    If R is singular, as it may be in discrete time, for u = 0.
    """
    A, B, E, Q, R, N = (rational(each) for each in (game.A, game.B, game.E, game.Q, game.R, game.N))
    Q, R = (Q + Q.transpose()) / 2, (R + R.transpose()) / 2
    cost = stacked_rationals([[Q], [N.transpose()]])
    if R.rank() == R.nrows():
        over_R = R.solve(N.transpose())
        A, cost = A - B * over_R, Q - N * over_R
    if not _never_costs(A, E, cost):
        return False
    others = unreachable_modes(A, E)
    modes = A.charpoly().numer()
    if others is not None:
        modes = modes // others if modes.degree() > others.degree() else modes * 0 + 1
    growth = math.sqrt(game.discount)
    return unstable_root(modes, growth, is_discrete=game.is_discrete) is None


def moves_nothing(game: Game, K: np.ndarray) -> bool:
    """Return whether the disturbance moves only states without cost, for u = -K z."""
    A, B, E, Q, R, N, K_exact = (
        rational(each) for each in (game.A, game.B, game.E, game.Q, game.R, game.N, K)
    )
    RK = (R + R.transpose()) / 2 * K_exact
    # Half the gradient of the cost z'Q z + 2 z'N u + u'R u by z and by u, at u = -K z.
    cost = stacked_rationals([[(Q + Q.transpose()) / 2 - N * K_exact], [N.transpose() - RK]])
    return _never_costs(A - B * K_exact, E, cost)


def _never_costs(A: fmpq_mat, E: fmpq_mat, cost: fmpq_mat) -> bool:
    """Return whether cost Aᵏ E = 0 for all k."""
    moved = E
    for _ in range(A.nrows()):
        if any(entry != 0 for entry in (cost * moved).entries()):
            return False
        moved = A * moved
    return True
