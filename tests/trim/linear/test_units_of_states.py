"""Facts about linear models do not depend on the units of states, against 50-digit arithmetic."""

from __future__ import annotations

from typing import NamedTuple

import flint
import numpy as np
import pytest
from flint import acb_poly, fmpq, fmpq_mat, fmpq_poly
from scipy.optimize import linear_sum_assignment

from hfa import LinearModel
from trim import linear_model_report


class Plant(NamedTuple):
    """x' = A x + B u, y = C x + D u."""

    A: np.ndarray
    B: np.ndarray
    C: np.ndarray
    D: np.ndarray

    def in_units(self, x, u, y):
        """Return the plant whose states, inputs and outputs are multiplied by these factors."""
        A, B, C, D = self
        return Plant(A * x[:, None] / x, B * x[:, None] / u, C / x * y[:, None], D * y[:, None] / u)


def blocks(random, n):
    """Return a stable block diagonal A with modes of .03 to 30 rad/s."""
    A = np.zeros((n, n))
    i = 0
    while i < n:
        speed = 10.0 ** random.uniform(-1.5, 1.5)
        if i + 1 < n and random.random() < 0.5:
            damping = 10.0 ** random.uniform(-1.5, -0.05)
            A[i : i + 2, i : i + 2] = [[0.0, 1.0], [-speed * speed, -2.0 * damping * speed]]
            i += 2
        else:
            A[i, i] = -speed
            i += 1
    return A


def mixed(random, inputs, outputs):
    """Return a stable plant of 2 to 8 states whose modes are mixed by a random matrix T.

    T has a condition number of at most 30, so that rounding moves the modes little.
    """
    n = int(random.integers(2, 9))
    while np.linalg.cond(T := np.eye(n) + 0.5 * random.normal(size=(n, n))) > 30.0:
        pass
    C = random.normal(size=(outputs, n)) if random.random() < 0.5 else np.eye(n)[:outputs]
    D = random.normal(size=(len(C), inputs)) * (random.random() < 0.4)
    return Plant(T @ blocks(random, n) @ np.linalg.inv(T), random.normal(size=(n, inputs)), C, D)


class Exact(NamedTuple):
    """Transfer function C (s I - A)⁻¹ B + D as a quotient of polynomials of rational numbers."""

    numerator: fmpq_poly
    denominator: fmpq_poly

    def at(self, s):
        with flint.ctx.workprec(500):
            upper, lower = (acb_poly(each.coeffs())(s) for each in self)
            return complex(upper / lower)


def roots(polynomial):
    return [complex(root) for root, count in polynomial.complex_roots() for _ in range(count)]


def exact(plant):
    """Return the exact transfer function of a plant with one input and one output."""
    # By det(s I - A + B C) = det(s I - A) (1 + C (s I - A)⁻¹ B).
    A, B, C, D = (
        fmpq_mat(*each.shape, [fmpq(*float(x).as_integer_ratio()) for x in each.ravel()])
        for each in plant
    )
    denominator = A.charpoly()
    return Exact((A - B * C).charpoly() + (D[0, 0] - 1) * denominator, denominator)


def apart(found, expected):
    """Return the largest relative difference of two sets of numbers, inf for other counts."""
    found, expected = np.array(found, dtype=complex), np.array([complex(each) for each in expected])
    if len(found) != len(expected):
        return np.inf
    differences = np.abs(found[:, None] - expected) / np.abs(expected)
    return float(differences[linear_sum_assignment(differences)].max(initial=0.0))


def test_linear_models_in_any_units_agree_with_rational_arithmetic():
    """Random stable plants in random units of states, inputs and outputs have the eigenvalues and the
    frequency response that `exact` computes in rational numbers.
    """
    random = np.random.default_rng(1)
    for _ in range(12):
        drawn = mixed(random, 1, 1)
        sizes = (len(drawn.A), 1, 1)
        plant = drawn.in_units(*(10.0 ** random.uniform(-6.0, 6.0, size) for size in sizes))
        linear, known = LinearModel.of(*plant), exact(plant)
        assert linear.is_stable
        modes = [mode.eigenvalue for mode in linear.modes]
        modes += [each.conjugate() for each in modes if each.imag]
        for found in (modes, linear.eigenvalues):
            assert apart(found, roots(known.denominator)) < 1e-6
        at_modes = linear_model_report(linear, responses=True).data
        (found,) = at_modes["responses"].values()
        for w, value in zip(at_modes["frequencies"], found @ [1.0, 1.0j], strict=True):
            gain = abs(known.at(0))
            assert value == pytest.approx(known.at(1j * w), rel=1e-9, abs=1e-12 * gain)
        system = linear.to_control(balance=True)
        for s in 1j * np.logspace(-3.0, 3.0, 9):
            value = known.at(s)
            # Where the value is below 1e-3 of the static gain, the error is relative to the gain.
            rel = 1e-9 + 1e-12 * abs(known.at(0) / value)
            assert system(s) == pytest.approx(value, rel=rel)
