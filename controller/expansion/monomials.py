"""Homogeneous polynomials: their monomials, values, gradients and changes of coordinates."""

from __future__ import annotations

import math
from collections.abc import Sequence
from functools import lru_cache
from itertools import combinations_with_replacement, permutations

import casadi as ca
import numpy as np

from controller.game.basis import Basis, monomials


@lru_cache(maxsize=64)
def homogeneous(n: int, degree: int) -> Basis:
    """Return all monomials of n variables with a degree, z1², z1 z2, z2² for n = 2."""
    exponents = monomials(n, degree)
    exponents.setflags(write=False)
    return Basis(f"degree {degree}", exponents)


@lru_cache(maxsize=64)
def monomial_scales(n: int, degree: int) -> np.ndarray:
    """Return sqrt(d! / (a1! ... an!)) of each monomial z^a of a degree d, (M,).

    With these factors, the squares of all monomials sum to |z|^(2 d), and a rotation of z changes
    the weights by an orthogonal matrix.
    """
    counts = [
        math.factorial(degree) / math.prod(map(math.factorial, row))
        for row in homogeneous(n, degree).exponents.tolist()
    ]
    return np.sqrt(counts)


def in_coordinates(weights: np.ndarray, degree: int, T: np.ndarray) -> np.ndarray:
    """Return the weights in z of a homogeneous polynomial that is given in y = T z, (k, M).

    A polynomial of degree 3 is Σ C_abc y_a y_b y_c with a symmetric array C, of which an entry is
    the weight of its monomial divided by the number of permutations of (a, b, c). In z, each axis
    of C is multiplied by T.

    weights: (k, M), k polynomials of the given degree
    degree: their degree
    T: (n, n)
    """
    n = len(T)
    factors = list(combinations_with_replacement(range(n), degree))  # (a, b, c) of y_a y_b y_c
    arrangements = monomial_scales(n, degree) ** 2  # number of permutations of (a, b, c)
    entries = weights / arrangements
    C = np.zeros((*(n,) * degree, len(weights)))  # C_abc of each polynomial
    for monomial, indices in enumerate(factors):
        for permuted in set(permutations(indices)):
            C[permuted] = entries[:, monomial]
    for axis in range(degree):  # y_a = sum of T_ai z_i
        C = np.moveaxis(np.tensordot(T, C, axes=(0, axis)), 0, axis)
    in_z = [C[indices] for indices in factors]
    return np.stack(in_z, axis=1) * arrangements


def polynomial(y: ca.SX, degree: int, weights: np.ndarray) -> ca.SX:
    """Return homogeneous polynomials W ψ(y) as CasADi expressions, (k,).

    y: (n,), expressions
    degree: degree of the monomials ψ
    weights: W, (k, M), of the monomials scaled by `monomial_scales`
    """
    # (a, b, c) -> y_a y_b y_c; a <= b <= c, so that each monomial is made once
    products: dict[tuple[int, ...], ca.SX] = {(): ca.SX(1.0)}
    for _ in range(degree):
        products = {
            (*factors, following): product * y[following]
            for factors, product in products.items()
            for following in range(factors[-1] if factors else 0, y.numel())
        }
    psi = ca.vertcat(*products.values()) * ca.DM(monomial_scales(y.numel(), degree))
    return ca.densify(ca.DM(weights) @ psi)


def name_of(exponents: Sequence[int], names: Sequence[str]) -> str:
    """Return a monomial as text, such as "speed*alpha**2".

    exponents: (n,)
    names: names of the n variables
    """
    factors = [
        name if power == 1 else f"{name}**{power}"
        for name, power in zip(names, exponents, strict=True)
        if power
    ]
    return "*".join(factors)
