"""Cost of a flight."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import casadi as ca
import numpy as np

from hfa_support.matrices import quadratic_forms


@dataclass(frozen=True, eq=False)
class Cost:
    """Cost ∫ z'Qz + 2z'Nv + v'Rv dt of the deviations of states z and inputs v.

    Q: (k, k)
    R: (m, m)
    N: (k, m), or None for 0
    """

    Q: np.ndarray
    R: np.ndarray
    N: np.ndarray | None = None

    def rate(self, z: Any, v: Any) -> Any:
        """Return the running cost z'Qz + 2z'Nv + v'Rv.

        As the rate of a further state, it is integrated with the order of the simulation.

        z, v: CasADi columns, or arrays (N, k) and (N, m). The result is then an array (N,)
        """
        if isinstance(z, np.ndarray):
            crossed = 0.0 if self.N is None else 2.0 * np.einsum("ij,jk,ik->i", z, self.N, v)
            return quadratic_forms(z, self.Q) + crossed + quadratic_forms(v, self.R)
        of_states = ca.bilin(ca.DM(self.Q), z, z)
        if self.N is not None:
            of_states += 2 * ca.dot(z, ca.DM(self.N) @ v)
        return of_states + ca.bilin(ca.DM(self.R), v, v)
