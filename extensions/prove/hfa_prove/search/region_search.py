"""What the searches for a region have in common: the problem, candidates for V, the result."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass

import casadi as ca
import numpy as np
import scipy.linalg

from hfa_prove.search.clock import Clock
from hfa_prove.search.shape_boxes import Shape
from hfa_prove.statements.loop import Loop
from hfa_prove.statements.region import RegionStatement, RegionWitness
from hfa_support.errors import BadInputError, NoSolutionError
from hfa_support.reporting.report import Report, Reported


@dataclass(frozen=True, eq=False)
class RegionProblem:
    """Closed loop whose region of attraction, or invariant set, is to be proved.

    loop: the loop, with disturbances for an invariant set
    known: pairs of a description and a matrix P, each of which gives a candidate V = z'P z
    """

    loop: Loop
    known: Sequence[tuple[str, np.ndarray]] = ()


@dataclass(frozen=True, eq=False, repr=False)
class Region(Reported):
    """A proved region of attraction or invariant set, displayed as the report of the command.

    statement: the proved statement
    witness: data for the proof
    size: number of boxes of the proof
    set: V of level 1, whose set {V <= 1, |y_i| < 1} is proved, in double precision
    extents: state -> lowest and highest deviation in the set
    origin: description of V
    stopped: reason why no larger set is proved, or ""
    """

    statement: RegionStatement
    witness: RegionWitness
    size: int
    set: Shape
    extents: Mapping[str, tuple[float, float]]
    origin: str
    stopped: str = ""

    @property
    def rho(self) -> float:
        """Proved level of V."""
        return self.statement.rho

    def report(self, policy: str = "") -> Report:
        """Return the report that `hfa prove region` prints.

        policy: description of the policy, or ""
        """
        from hfa_prove.report import found_report

        lines = [f"Policy: {policy}."] if policy else []
        lines.append(
            f"Origin of V: {self.origin}. Degree: {self.statement.degree}. Proved on {self.size} "
            "boxes."
        )
        if self.stopped:
            lines.append(f"No larger set is proved: {self.stopped}.")
        data = {"origin": self.origin, "stopped": self.stopped}
        return found_report(self.statement, self.size, "\n".join(lines), data=data)


@dataclass(frozen=True, eq=False)
class Settings:
    """Settings of a search.

    degree: highest degree of V
    clock: limit of the processor time, and progress
    save: called with each larger region that is proved, or None
    """

    degree: int
    clock: Clock
    save: Callable[[Region], None] | None = None


def lyapunov_matrices(J: np.ndarray, nominal: np.ndarray, count: int) -> Iterator[np.ndarray]:
    """Yield positive definite P (n, n) with J'P + P J = -diag(w²), J the matrix of the linear loop.

    The first weights w (n,) are 1 / nominal. Each entry of the other weights is this value times a
    random factor from 0.1 to 10.

    count: number of weights
    """
    generator = np.random.default_rng(0)
    for index in range(count):
        factors = 10.0 ** generator.uniform(-1.0, 1.0, len(J))
        weights = factors / nominal if index > 0 else 1.0 / nominal
        P = scipy.linalg.solve_continuous_lyapunov(J.T, -np.diag(weights**2))
        if np.all(np.linalg.eigvalsh(P) > 0.0):
            yield P


def refuse_unstable(J: np.ndarray) -> None:
    """Raise NoSolutionError unless every eigenvalue of J (n, n) has a negative real part.

    J: linearization of the loop
    """
    modes = np.linalg.eigvals(J)
    if not np.all(modes.real < 0.0):
        raise NoSolutionError(
            "the loop's linearization is not Hurwitz (largest real part of an eigenvalue: "
            f"{modes.real.max():.3g}); only equilibria with a stable linearization are supported"
        )


def refuse_boundless(loop: Loop, J: np.ndarray) -> None:
    """Raise BadInputError if a stable loop is linear and has no limits: its region has no end.

    J: matrix of the loop, (n, n)
    """
    x = ca.SX.sym("x", len(loop.states))
    is_linear = not any(ca.which_depends(loop.rates(x)[0], x, 2, True))
    if is_linear and not loop.limits:
        raise BadInputError(
            f"{loop.model.title}: the loop is linear and has no limits, so it is stable from every "
            f"state (largest real part of a pole: {np.linalg.eigvals(J).real.max():.3g}); "
            "--limit NAME=LOW:HIGH of an input or a state bounds a region"
        )
