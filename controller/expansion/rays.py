"""Power series along rays: F(t z, t u1 + t² u2 + ...) = t f1 + t² f2 + ..."""

from __future__ import annotations

import math

import casadi as ca
import numpy as np

from hfa_support.errors import BadInputError


class Rays:
    """Taylor coefficients of the rates F(z, u) along rays, computed at many rays at once.

    The ray is t -> (t z, t u1 + t² u2 + ...), with the coefficients f1, f2, ... of the rates. Along
    the gradient λ(t) = t λ1 + t² λ2 + ... of a value, the derivative of λ'F with respect to u has
    the coefficients g1, g2, ...
    """

    def __init__(self, rates: ca.Function, highest: int) -> None:
        """Differentiate the rates.

        rates: CasADi Function (z, u) -> F(z, u)
        highest: order of the last coefficient
        """
        n = rates.size1_in(0)
        m = rates.size1_in(1)
        t = ca.SX.sym("t")
        z = ca.SX.sym("z", n)
        u = [ca.SX.sym(f"u{order}", m) for order in range(1, highest + 1)]
        gradients = [ca.SX.sym(f"l{order}", n) for order in range(1, highest + 1)]
        u_on_ray = sum((t**order * part for order, part in enumerate(u, 1)), ca.SX.zeros(m))
        derivative = rates(t * z, u_on_ray)
        f: list[ca.SX] = []  # f1, f2, ...: derivatives at t = 0 over 1!, 2!, ...
        self._functions = []
        for order in range(1, highest + 1):
            derivative = ca.jacobian(derivative, t)
            f.append(ca.substitute(derivative, t, 0) / math.factorial(order))
            # the coefficient of λ'F: λ1'f_k + λ2'f_(k-1) + ... + λk'f1
            terms = zip(f, reversed(gradients[:order]), strict=True)
            product = sum((ca.dot(rate, gradient) for rate, gradient in terms), ca.SX(0))
            arguments = [z, *u[:order], *gradients[:order]]
            results = [ca.densify(f[-1]), ca.densify(ca.gradient(product, u[0]))]
            self._functions.append(ca.Function(f"ray{order}", arguments, results))

    def __call__(
        self, z: np.ndarray, u: list[np.ndarray], gradients: list[np.ndarray]
    ) -> tuple[np.ndarray, np.ndarray]:
        """Return the coefficients f_k (n, N) and g_k (m, N) on N rays.

        z: (n, N), directions
        u: k arrays (m, N), u1 ... uk. g_k does not depend on uk.
        gradients: k arrays (n, N), λ1 ... λk

        Raises BadInputError if a derivative is not finite.
        """
        results = self._functions[len(u) - 1](z, *u, *gradients)
        rates, slopes = (np.array(result) for result in results)
        if not (np.isfinite(rates).all() and np.isfinite(slopes).all()):
            raise BadInputError(
                f"the derivatives of order {len(u)} of the equations are not finite at the trim; "
                "choose a lower order or another trim"
            )
        return rates, slopes
