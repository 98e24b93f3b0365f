"""Parts of adaptive laws: each solves the equation that its docstring states."""

from __future__ import annotations

import casadi as ca
import numpy as np
from scipy.integrate import solve_ivp

from verification.servo.adaptive_parts import A0, A1, A2, MU, Filter, MemoryParts, Tuner, operated, product_rate


def test_the_memory_keeps_parts_starts_and_rates_in_order() -> None:
    y = ca.SX.sym("y", 7)
    memory = MemoryParts(y)
    one, other = memory.take(2, 2, np.array([[1.0, 2.0], [3.0, 4.0]])), memory.take(3)
    memory.move(other, 3 * other.now)
    memory.move(one, 2 * one.now)
    rate = ca.Function("rate", [y], [memory.rate])(np.arange(7.0))
    np.testing.assert_allclose(np.array(rate).ravel(), [0, 2, 4, 6, 12, 15, 18])
    np.testing.assert_allclose(memory.start, [1, 3, 2, 4, 0, 0, 0])


def test_a_filter_has_the_response_of_its_transfer_functions() -> None:
    """Driven by sin ωt, low and high settle to α2 / Π and (α2 s + α1) / Π at s = iω, derivatives to s times that."""
    w, y, t = 1.3, ca.SX.sym("y", 2), ca.SX.sym("t")
    memory = MemoryParts(y)
    driven = Filter(memory, 1).drive(ca.sin(w * t))
    high = driven.high(w * ca.cos(w * t))
    seen = ca.Function("seen", [t, y], [memory.rate, ca.vertcat(*driven.low, *high)])
    path = solve_ivp(lambda t, y: np.array(seen(t, y)[0]).ravel(), (0.0, 40.0), np.zeros(2), rtol=1e-9, atol=1e-12)
    s = 1j * w
    bottom = A2 * s**2 + A1 * s + A0
    for response, first in ((A2 / bottom, 0), ((A2 * s + A1) / bottom, 3)):
        expected = [np.imag(response * s**k * np.exp(s * 40.0)) for k in range(3)]
        found = np.array(seen(40.0, path.y[:, -1])[1]).ravel()[first : first + 3]
        np.testing.assert_allclose(found, expected, atol=1e-6)


def test_a_tuner_comes_to_rest_at_what_it_was_driven_to() -> None:
    """Φ' = γ ν e' for a second, then e = 0: Ψ goes to Φ = γ ν e' whatever its speed g, and starts where it was said."""
    y, e, nu = ca.SX.sym("y", 12), ca.SX.sym("e", 2), np.array([3.0, -4.0])
    memory = MemoryParts(y)
    psi, psi_rate, _ = Tuner(memory, 2, 2, np.eye(2)).drive(0.5, ca.SX(ca.DM(nu)), e)
    seen = ca.Function("seen", [y, e], [memory.rate, psi, psi_rate])
    g = 1 + MU * 25.0
    np.testing.assert_allclose(np.array(seen(memory.start, [0, 0])[1]), g * np.eye(2))

    def path(y: np.ndarray, error: np.ndarray, seconds: float) -> np.ndarray:
        found = solve_ivp(lambda _, y: np.array(seen(y, error)[0]).ravel(), (0.0, seconds), y, rtol=1e-9, atol=1e-12)
        end: np.ndarray = found.y[:, -1]
        return end

    error = np.array([0.2, 0.1])
    end = path(path(memory.start, error, 1.0), np.zeros(2), 60.0)
    np.testing.assert_allclose(np.array(seen(end, [0, 0])[1]), np.eye(2) + 0.5 * np.outer(nu, error), atol=1e-6)
    np.testing.assert_allclose(np.array(seen(end, [0, 0])[2]), 0.0, atol=1e-6)


def test_products_are_differentiated_by_the_product_rule() -> None:
    """Ψ and x cubic in t: derivatives of Ψ'x by CasADi."""
    rng, t = np.random.default_rng(3), ca.SX.sym("t")
    powers = [1, t, t**2, t**3]
    Psi = sum(ca.DM(rng.normal(size=(3, 2))) * each for each in powers)
    x = sum(ca.DM(rng.normal(size=3)) * each for each in powers)

    def derivatives(value: ca.SX) -> list[ca.SX]:
        flat = [ca.vec(value)]
        for _ in range(2):
            flat.append(ca.jacobian(flat[-1], t))
        return [ca.reshape(each, *value.shape) for each in flat]

    product = derivatives(ca.mtimes(Psi.T, x))
    expected = A0 * product[0] + A1 * product[1] + A2 * product[2]
    off = ca.vertcat(
        product_rate(derivatives(Psi), derivatives(x)) - product[1],
        operated(derivatives(Psi), derivatives(x)) - expected,
    )
    np.testing.assert_allclose(np.array(ca.Function("off", [t], [off])(0.7)), 0.0, atol=1e-12)
