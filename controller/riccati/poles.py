"""Eigenvalues of loops of balls, enclosed in discs.

Source: Gershgorin's theorem: each eigenvalue of a matrix D is in one of the discs about D_ii with
the sum of |D_ij| over the other entries of row i as radius.
"""

from __future__ import annotations

from collections.abc import Callable
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from controller.riccati.balls import (
    ATTEMPTS,
    ROUNDOFF,
    ball_matrix,
    identity,
    midpoints,
    norm,
    precision,
    scaled_balls,
)
from controller.riccati.lyapunov import FailedError, NotProvedError, half_the_bits, loop_units

if TYPE_CHECKING:
    from flint import acb, acb_mat, arb, arb_mat

#: Largest number of corrections of proposed eigenvectors; each doubles their digits.
CORRECTIONS = 4
#: A radius, relative to the size of the loop, that needs no correction.
SMALL = 2.0**-105


class Poles(NamedTuple):
    """Eigenvalues λ of a loop, in discs |λ - value| <= radius about numbers that `values` round.

    A union of discs that overlap no others contains as many eigenvalues as values.

    values: (n,) complex, sorted by real, then by imaginary part
    radii: (n,)
    """

    values: np.ndarray
    radii: np.ndarray

    @property
    def abscissa(self) -> float:
        """Largest real part of a value."""
        return float(self.values.real.max())

    @property
    def spectral_radius(self) -> float:
        """Largest magnitude of a value."""
        return float(np.abs(self.values).max())


def poles_of(loop: Callable[[int], arb_mat], *, is_discrete: bool) -> Poles:
    """Return the enclosed eigenvalues of a loop, with as many bits as give each digit.

    In continuous time, the digits of the real parts are asked for, in discrete time those of the
    spectral radius. A multiple eigenvalue may remain uncertain.

    loop: bits -> the loop, (n, n), balls
    """
    best: Poles | None = None
    for n_bits in ATTEMPTS:
        with precision(n_bits):
            try:
                poles = enclosed_poles(loop(n_bits))
            except (FailedError, NotProvedError):
                continue
        if best is None or poles.radii.max() < best.radii.max():
            best = poles
        sizes = np.abs(best.values) if is_discrete else np.abs(best.values.real)
        if (best.radii <= ROUNDOFF * (sizes.max() if is_discrete else sizes)).all():
            break
    assert best is not None
    return best


def enclosed_poles(loop: arb_mat) -> Poles:
    """Return the enclosed eigenvalues of a loop, (n, n), balls, with the bits of `precision`.

    The discs of Gershgorin of V⁻¹ F V contain them for any V. They are small if the columns of V
    are nearly eigenvectors: by LAPACK if their corrections converge, otherwise by FLINT.
    """
    from flint import acb_mat

    units = loop_units(midpoints(loop))
    F = scaled_balls(loop, -units, units)
    half_the_digits = norm(F) * half_the_bits()
    similar = _in_eigenvectors(F)
    if not similar.largest_radius <= float(half_the_digits) ** 0.5:
        # Multiple eigenvalues differ where the loop is changed by half its digits.
        change = ball_matrix(np.random.default_rng(1).normal(size=(len(units), len(units))))
        changed = (F + change * half_the_digits).mid()
        vectors = _normalized(acb_mat(changed).eig(right=True, algorithm="approx")[1])
        similar = min(similar, Similar.of(F, vectors), key=lambda each: each.largest_radius)
    return similar.discs


def _in_eigenvectors(F: arb_mat) -> Similar:
    """Return the loop in its eigenvectors by LAPACK, corrected as long as that helps."""
    from flint import acb_mat

    n = F.nrows()
    vectors = np.linalg.eig(midpoints(F))[1]
    similar = Similar.of(F, acb_mat(n, n, [complex(entry) for entry in vectors.ravel()]))
    for _ in range(CORRECTIONS):
        if similar.largest_radius <= SMALL * float(norm(F)):
            break
        corrected = Similar.of(F, similar.corrected())
        if not corrected.largest_radius < 0.5 * similar.largest_radius:
            break
        similar = corrected
    return similar


def _normalized(V: acb_mat) -> acb_mat:
    """Return the columns of V, each divided by the magnitude of its largest entry."""
    from flint import acb_mat

    columns = V.transpose().tolist()
    sizes = [max((abs(entry).mid() for entry in column), key=float) for column in columns]
    scaled = [
        [entry / size for entry in column] for column, size in zip(columns, sizes, strict=True)
    ]
    return acb_mat(scaled).transpose().mid()


class Similar(NamedTuple):
    """Loop F in other states, D = V⁻¹ F V, which is nearly diagonal.

    V, D: (n, n), balls
    """

    V: acb_mat
    D: acb_mat

    @classmethod
    def of(cls, F: arb_mat, V: acb_mat) -> Similar:
        """Return F with the columns of V as states, or as it is if V may be singular."""
        from flint import acb_mat

        try:
            return cls(V, V.solve(acb_mat(F) * V))
        except ZeroDivisionError:
            return cls(acb_mat(identity(F.nrows())), acb_mat(F))

    @property
    def discs(self) -> Poles:
        """Discs of Gershgorin, each about D_ii."""
        radii = np.array([float(radius) for radius in self._radii()])
        values = np.array([complex(row[i].mid()) for i, row in enumerate(self.D.tolist())])
        # An isolated disc that meets the real axis contains a real eigenvalue.
        is_real = np.abs(values.imag) <= radii
        radii = np.where(is_real, radii + np.abs(values.imag), radii)
        values.imag[is_real] = 0.0
        order = np.lexsort((values.imag, values.real))
        return Poles(values[order], radii[order])

    @property
    def largest_radius(self) -> float:
        """Largest radius of a disc."""
        return max(map(float, self._radii()))

    def _radii(self) -> list[arb]:
        """Return the radii of the discs: that of D_ii and the magnitudes of its row, rounded up."""
        from flint import arb

        radii = []
        for i, row in enumerate(self.D.tolist()):
            others = [abs(entry) for j, entry in enumerate(row) if j != i]
            radii.append(sum(others, row[i].rad() + arb(0)).upper())
        return radii

    def corrected(self) -> acb_mat:
        """Return the eigenvectors V (1 + X), to the first order in the other entries of D.

        X_ij = D_ij / (D_jj - D_ii), or 0 where this is not small.
        """
        from flint import acb_mat

        rows = self.D.mid().tolist()
        values = [row[i] for i, row in enumerate(rows)]

        def X_entry(i: int, j: int) -> acb:
            gap = values[j] - values[i]
            is_small = i != j and abs(rows[i][j]) < 0.1 * abs(gap)
            return rows[i][j] / gap if is_small else 0 * gap

        n = len(values)
        X = acb_mat([[X_entry(i, j) for j in range(n)] for i in range(n)])
        return (self.V + self.V * X).mid()
