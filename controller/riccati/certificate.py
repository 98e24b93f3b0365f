"""Certificate of a game solution: what is proved, and how much K depends on the last digits."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, NamedTuple

import numpy as np

from controller.riccati.balls import DoubleBalls, midpoints, precision
from controller.riccati.enclosure import Enclosure, uncertainty
from controller.riccati.equation import StepEquation, scaled_balls
from controller.riccati.level import levelled
from controller.riccati.proposal import FailedError, lyapunov_in_bits, lyapunov_of
from hfa_support.reporting.results import Result

if TYPE_CHECKING:
    from flint import arb, arb_mat

#: Largest change of K by the last digits of the game's entries.
GAIN_CHANGE = 0.01
#: A gain that changes A by less than this fraction of |A| is compared with this fraction.
NOTICED = 1e-10
#: A damping above this fraction of the fastest rate is more than the last digits of the entries.
UNDAMPED = 1e-12


@dataclass(frozen=True)
class Certificate(Result):
    """What is proved of a solution, in ball arithmetic, for the exact entries of the game.

    proved: sentences
    radius: largest radius of the balls that contain P and K, relative to the sizes of their rows
    bits: of the proof
    last_digits: changes of the solution if the entries of the game change in their last digit
    """

    proved: tuple[str, ...]
    radius: float
    bits: int
    last_digits: LastDigits

    @property
    def gain_change(self) -> float:
        """Change of B K if every entry of the game changes in its last digit, relative."""
        return self.last_digits.gain

    def _entries(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "ok": True,
            "proved": self.proved,
            "radius": self.radius,
            "bits": self.bits,
            "gain_change": self.gain_change,
        }


def certificate_of(enclosure: Enclosure) -> Certificate:
    """Return the certificate of an enclosed solution."""
    equation = enclosure.proved.equation
    game = equation.game
    with precision(enclosure.bits):
        radius = float(uncertainty(enclosure.proved, zeros=True).upper())
    stable = "Hurwitz"
    loops: tuple[str, ...] = ("A - B K + E L", "A - B K")
    if game.is_discrete:
        stable = "stable"
        if game.discount != 1.0:
            loops = tuple(f"sqrt(discount) ({loop})" for loop in loops)
    proved = [
        f"P and K are right to the last digit (enclosed with the radius {radius:.1g},"
        f" {enclosure.bits} bits)",
        f"{' and '.join(loops)} are {stable}, and P is positive semidefinite",
    ]
    if not equation.is_disturbed:
        proved[1] = f"{loops[1]} is {stable}, and P is positive semidefinite"
    elif game.is_discrete:
        proved.append("the disturbance pays: delta^2 - E'P E > 0")
    if equation.is_disturbed:
        proved.append(f"L is enclosed with the radius {_radius_of_L(enclosure):.1g}")
    if enclosure.is_raised:
        proved = [text.replace(", and P is positive semidefinite", "") for text in proved]
        proved.append(
            "Q, R and N are positive semidefinite up to rounding only: a value, with P positive"
            " semidefinite, is proved for weights whose diagonals are larger by 2e-12"
        )
    with precision(enclosure.bits):
        changes = last_digits(enclosure)
    return Certificate(tuple(proved), radius, enclosure.bits, changes)


def _radius_of_L(enclosure: Enclosure) -> float:
    """Return the largest radius of L, relative to the largest entry of its row in units of the
    proof; inf if no digit of a row is known.
    """
    units = enclosure.proved.equation.units.states
    with precision(enclosure.bits):
        L = scaled_balls(enclosure.L, np.zeros(enclosure.L.nrows(), dtype=int), units)
        worst = 0.0
        for row in L.tolist():
            radius, largest = max(entry.rad() for entry in row), max(map(_size, row))
            worst = max(worst, float((radius / largest).upper()) if radius > 0 else 0.0)
    return worst if math.isfinite(worst) else math.inf


def _size(entry: arb) -> arb:
    return abs(entry.mid())


class LastDigits(NamedTuple):
    """Changes of a solution, to the first order, if its entries change in their last digit.

    gain: |B (K2 - K)| / |B K|
    damping: change of the damping of a pole of A - B K, relative; 0 if it is far below 1
    pole: whose damping changes most, in discrete time of sqrt(discount) (A - B K)
    """

    gain: float
    damping: float = 0.0
    pole: complex = 0.0

    @property
    def doubt(self) -> str:
        """What the entries do not determine, as one sentence, or ""."""
        if self.damping > GAIN_CHANGE:
            pair = f" ± {abs(self.pole.imag):.4g}i" if abs(self.pole.imag) > 1e-9 else ""
            return (
                f"the mode with eigenvalue {self.pole.real:.1g}{pair} of the closed loop is"
                " undamped up to the last digits of the entries of the game; give it weight in Q,"
                " or an input that reaches it"
            )
        if not self.gain <= GAIN_CHANGE:
            return (
                f"K changes by {100.0 * self.gain:.2g} % if the entries of the game change in their"
                " last digit: they do not determine K"
            )
        return ""


def last_digits(enclosure: Enclosure) -> LastDigits:
    """Return how entries that change in their last digit change K and the poles of A - B K.

    The changes of the entries move P by the solution of a Lyapunov equation. Each entry of A, B
    and E is multiplied by a factor f = 1 ± eps, and the entries ij of Q, N and R by f_i f_j, with
    which the weights remain semidefinite. All is computed in the arithmetic of the proof.
    """
    with np.errstate(all="ignore"):
        try:
            return _last_digits(enclosure)
        except (FailedError, np.linalg.LinAlgError, ValueError, ZeroDivisionError):
            return LastDigits(math.inf)


def _last_digits(enclosure: Enclosure) -> LastDigits:
    found = enclosure.proved
    equation = found.bounds
    number = equation.arithmetic
    n, m = equation.n, equation.R.nrows()
    A, B, E, Q, N, R = (
        *(equation.A, equation.B, equation.E, equation.Q, equation.N),
        number.of(equation.R),
    )
    signs = _signs(n * (n + m + enclosure.game.E.shape[1]))
    of_A, of_B, of_E = np.split(np.finfo(float).eps * signs, [n * n, n * (n + m)])
    of_states, of_inputs = of_A[:n], of_B[:m]

    def changed(matrix: Any, factors: np.ndarray) -> Any:
        middle = _middle(matrix)
        return number.of(middle * factors.reshape(middle.shape))

    dA, dB, dE = changed(A, of_A), changed(B, of_B), changed(E, of_E)
    dQ = changed(Q, np.add.outer(of_states, of_states))
    dN = changed(N, np.add.outer(of_states, of_inputs))
    dR = changed(R, np.add.outer(of_inputs, of_inputs))
    X, gains = number.of(found.X), number.of(found.gains.mid())
    K, F = gains.block(slice(m), slice(None)), equation.loop(X, gains)
    pushed = dA - dB @ K
    if equation.is_disturbed:
        L = -gains.block(slice(m, None), slice(None))
        if not equation.is_discrete:
            L = (E.T @ X).times(equation.w)
        pushed = pushed + dE @ L
    crossed = dN @ K
    moved = dQ - crossed - crossed.T + K.T @ (dR @ K)
    cross = F.T @ (X @ pushed) if equation.is_discrete else X @ pushed
    moved = moved + cross + cross.T
    Z = number.of(_moved_value(F, moved, is_discrete=equation.is_discrete))
    own = dN.T - dR @ K
    if isinstance(equation, StepEquation):
        dG = dB.beside(dE) if equation.is_disturbed else dB
        right = equation.G.T @ (Z @ F + X @ pushed) + dG.T @ (X @ F)
        others = number.of(np.zeros((n, gains.rows - m)))
        right = right + own.T.beside(others).T
        price = number.of(equation.W) + equation.G.T @ (X @ equation.G)
        dK = number.of(_solved(price, right)).block(slice(m), slice(None))
    else:
        dK = number.of(_solved(R, B.T @ Z + dB.T @ X + own))
    pushed_by_K, change = (float(np.linalg.norm(_middle(B @ each))) for each in (K, dK))
    size = max(pushed_by_K, NOTICED * float(np.linalg.norm(_middle(A)))) or 1.0
    gain = change / size if math.isfinite(change) else math.inf
    if number is DoubleBalls:  # a pole so near the boundary is not proved stable in doubles
        return LastDigits(gain)
    return _with_poles(gain, enclosure, (dA - dB @ K - B @ dK).matrix)


def _middle(matrix: Any) -> np.ndarray:
    """Return the midpoints of a matrix of balls of either arithmetic."""
    is_fast = isinstance(matrix, DoubleBalls)
    return matrix.midpoint if is_fast else midpoints(matrix.matrix)


def _moved_value(F: Any, moved: Any, *, is_discrete: bool) -> np.ndarray | arb_mat:
    """Return Z of F'Z + Z F + moved = 0, (n, n), in discrete time F'Z F - Z + moved = 0."""
    if isinstance(F, DoubleBalls):
        solver = lyapunov_of(F.midpoint, is_discrete=is_discrete)
        return solver.solve(-moved.midpoint)[0]
    return lyapunov_in_bits(F.matrix.mid(), moved.matrix.mid(), is_discrete=is_discrete)


def _solved(matrix: Any, right: Any) -> np.ndarray | arb_mat:
    """Return matrix⁻¹ right."""
    if isinstance(matrix, DoubleBalls):
        return np.linalg.solve(matrix.midpoint, right.midpoint)
    return matrix.matrix.mid().solve(right.matrix.mid()).mid()


def _with_poles(gain: float, enclosure: Enclosure, dF: arb_mat) -> LastDigits:
    """Return the changes with that of the damping of a pole.

    dF: change of A - B K, (n, n), in the units of the enclosure
    """
    from scipy.linalg import eig

    level, game = levelled(enclosure), enclosure.game
    values, left, right = eig(math.sqrt(game.discount) * level.loop, left=True)
    moved = midpoints(level.to_level * dF * level.from_level)
    sizes = np.abs(np.einsum("ij,ij->j", left.conj(), moved @ right))
    sizes /= np.abs(np.vecdot(left.T, right.T))
    damping = 1.0 - np.abs(values) if game.is_discrete else -values.real
    # Only such a damping may be rounding of the entries.
    small = damping < UNDAMPED * float(np.abs(values).max(initial=0.0))
    changes = np.where(small & (sizes > 0.0), sizes / np.maximum(damping, 0.0), 0.0)
    worst = int(np.argmax(changes))
    return LastDigits(gain, float(changes[worst]), complex(values[worst]))


def _signs(count: int) -> np.ndarray:
    """Return the signs of sin(k² + 1), (count,), which have no pattern."""
    k = np.arange(count)
    return np.sign(np.sin(k**2 + 1.0))
