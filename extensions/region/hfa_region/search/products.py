"""Products of pairs of monomials in a Gram matrix, and the Schur matrix of their sums."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache, lru_cache

import numpy as np
import scipy.sparse as sp

from verification.enclosure.polynomial import exponents_of, monomials

#: Base of the exponents in one whole number.
BASE = 16
#: Largest number of entries of the matrices of a block; larger arrays do not fit in the cache.
_ENTRIES = 60_000


@cache
def packed(key: int) -> int:
    """Return the exponents α of a monomial's key packed into one number, Σ α_i 16^i."""
    return sum(power * BASE**i for i, power in enumerate(exponents_of(key)))


@lru_cache(maxsize=64)
def packed_monomials(variables: int, low: int, high: int) -> np.ndarray:
    """Return the monomials of `monomials` as packed numbers, in the same order.

    low, high: lowest and highest degree
    """
    return np.array([packed(key) for key in monomials(variables, low, high)], dtype=np.int64)


@dataclass(frozen=True, eq=False)
class _Block:
    """Consecutive products of one degree, with the n monomials of their matrices.

    The monomials are those that occur in products of this degree or a higher degree. k is the
    number of products.

    start: index of the first monomial
    first, last: range of the indices of the products
    stacked: matrices of the products, one below the other, (k n, n)
    sums: entries that each product from `first` on has in the matrix of monomials, (l, n²)
    """

    start: int
    first: int
    last: int
    stacked: sp.csr_matrix
    sums: sp.csr_matrix


@dataclass(frozen=True, eq=False)
class Products:
    """Different products of pairs of n monomials m.

    size: number of monomials n
    keys: packed keys of the products, by degree, (k,)
    sums: (k, n²), 1 where an entry of the matrix m m' equals the product
    blocks: products of one degree each, in blocks whose matrices fit in the processor's cache
    """

    size: int
    keys: np.ndarray
    sums: sp.csr_matrix
    blocks: Sequence[_Block]

    def schur(self, Q: np.ndarray, inverse: np.ndarray) -> np.ndarray:
        """Return the matrix (k, k) with entries tr(H_i Z⁻¹ H_j Q).

        H_i is the matrix (n, n) of product i, with entries 1 where m m' equals the product.

        Q: symmetric matrix, (n, n)
        inverse: Z⁻¹, symmetric, (n, n)
        """
        M = np.zeros((len(self.keys), len(self.keys)))
        for block in self.blocks:
            n = self.size - block.start
            kept = slice(block.start, None)
            right = (block.stacked @ Q[kept, kept]).reshape(-1, n, n)
            scaled = np.matmul(inverse[kept, kept], right).reshape(-1, n * n)
            own = slice(block.first, block.last)
            M[block.first :, own] = block.sums @ scaled.T
            M[own, block.last :] = M[block.last :, own].T
        return M


@lru_cache(maxsize=64)
def products_of(variables: int, low: int, high: int) -> Products:
    """Return the products of pairs of monomials of the degrees low to high.

    variables: number of variables
    """
    own = packed_monomials(variables, low, high)
    counts = [len(monomials(variables, degree, degree)) for degree in range(low, high + 1)]
    degrees = np.repeat(np.arange(low, high + 1), counts)
    pairs = (own[:, None] + own).ravel()
    degrees_of_pairs = (degrees[:, None] + degrees).ravel()
    _, firsts = np.unique(pairs, return_index=True)
    firsts = firsts[np.lexsort((pairs[firsts], degrees_of_pairs[firsts]))]
    keys = pairs[firsts]
    by_degree = degrees_of_pairs[firsts]
    entries = np.arange(len(pairs))
    order = np.argsort(keys)
    places = order[np.searchsorted(keys, pairs, sorter=order)]
    shape = (len(keys), len(pairs))
    sums = sp.csr_matrix((np.ones(len(pairs)), (places, entries)), shape=shape)
    blocks = []
    for degree in np.unique(by_degree).tolist():
        start = int(np.searchsorted(degrees, degree - high))
        begin, end = np.searchsorted(by_degree, [degree, degree + 1]).tolist()
        taken = np.arange(len(own)) >= start
        inner = sums[:, np.outer(taken, taken).ravel()]
        count = max(1, _ENTRIES // (len(own) - start) ** 2)
        for first in range(begin, end, count):
            last = min(first + count, end)
            stacked = inner[first:last].reshape((-1, len(own) - start)).tocsr()
            blocks.append(_Block(start, first, last, stacked, inner[first:]))
    return Products(len(own), keys, sums, blocks)
