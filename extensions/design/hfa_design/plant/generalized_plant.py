"""H-infinity control of a generalized plant, as in `hinfsyn`: certified state or output feedback.

x' = A x + B1 w + B2 u,  z = C1 x + D11 w + D12 u,  y = C2 x + D21 w + D22 u

The controller must achieve ‖z‖ < δ ‖w‖ for every w. Each Riccati equation is that of a `Game`
(`Side`). Sources: Zhou, Doyle and Glover, Robust and Optimal Control, Chapter 17. Glover and Doyle
1988.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields, replace
from functools import cached_property
from pathlib import Path
from typing import Any

import numpy as np

from controller.game.zero_sum import Game, check_definite
from controller.riccati.balancing import abscissa_of
from controller.riccati.certificate import certified_solution
from controller.riccati.delta_search import Answer, smallest_delta
from controller.riccati.frequency_response import (
    responses,
    scaled_root,
    square_root,
    system_gain,
)
from controller.riccati.normal_form import RANK, NormalForm
from controller.riccati.smallest_delta import DeltaMin
from hfa_aircraft.readers.matrices_file import entries_of, one_number
from hfa_design.plant.plant_axes import Axes
from hfa_design.plant.plant_side import Side
from hfa_support.arguments import checks_arguments
from hfa_support.arrays.read import read_arrays
from hfa_support.errors import (
    BadInputError,
    NoSolutionError,
    prefix_errors,
    refuse_unless_positive,
    shortened,
)
from hfa_support.matrices import LARGEST, checked_matrix, spectral_radius
from hfa_support.reporting.checks import Check, at_most, below
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import Matrix

#: Largest relative difference between the responses of both derivations of the controller.
DERIVATIONS_AGREE = 1e-8
#: Relative accuracy of delta_min.
TOLERANCE = 2.5e-7
COUPLING = "coupling condition"

#: For control and filter side: messages on an unstable mode that cannot be controlled or observed,
#: and on a zero on the imaginary axis.
_OBSTACLES = (
    (
        "within rounding no input reaches the {}, which is not stable; change B2",
        (
            "within rounding z does not observe the {}, which does not decay (a zero from u to z on"
            " the imaginary axis); include it in z"
        ),
    ),
    (
        "within rounding the sensors do not observe the {}, which is not stable; measure more",
        (
            "within rounding the disturbance does not reach the {}, which does not decay, so its"
            " estimate would never settle; let the disturbance enter there"
        ),
    ),
)

#: Ak, Bk, Ck, Dk.
Controller = tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]


@checks_arguments
@dataclass(frozen=True, eq=False, repr=False)
class GeneralizedPlant(Reported):
    """Generalized plant x' = A x + B1 w + B2 u, z = C1 x + D11 w + D12 u, y = C2 x + D21 w + D22 u.

    w are the disturbances, u the inputs, z the outputs whose size is the cost, and y the
    measurements. Without C2, all states are measured exactly (state feedback).

    A: (n, n)
    B1: (n, k)
    B2: (n, m)
    C1: (r, n)
    D12: (r, m)
    C2: (p, n); by default p = 0
    D21: (p, k)
    D11: (r, k), by default 0
    D22: (p, m), by default 0

    Raises BadInputError if a shape is wrong, or unless D12 has rank m and D21 rank p.
    """

    A: np.ndarray
    B1: np.ndarray
    B2: np.ndarray
    C1: np.ndarray
    D12: np.ndarray
    C2: Any = None
    D21: Any = None
    D11: Any = None
    D22: Any = None

    def __post_init__(self) -> None:
        """Raise BadInputError if a matrix is missing or has a wrong shape or rank."""
        matrices = {}
        for each in fields(self):
            matrix = getattr(self, each.name)
            if matrix is not None:
                matrices[each.name] = checked_matrix(each.name, matrix, LARGEST)
        needed = ["A", "B1", "B2", "C1", "D12"]
        if "C2" in matrices:
            needed.append("D21")
        elif "D21" in matrices or "D22" in matrices:
            raise BadInputError(
                "D21 or D22 is given without C2; add C2, or remove both for state feedback"
            )
        for name in needed:
            if name not in matrices:
                raise BadInputError(
                    f"{name} is missing; give A, B1, B2, C1, D12 and, with measurements, C2 and D21"
                )
        n = len(matrices["A"])
        k = matrices["B1"].shape[1]
        m = matrices["B2"].shape[1]
        r = len(matrices["C1"])
        p = len(matrices.get("C2", ()))
        shapes = {
            "A": (n, n),
            "B1": (n, k),
            "B2": (n, m),
            "C1": (r, n),
            "D12": (r, m),
            "D11": (r, k),
            "C2": (p, n),
            "D21": (p, k),
            "D22": (p, m),
        }
        for name, shape in shapes.items():
            matrix = matrices.get(name, np.zeros(shape))
            if matrix.shape != shape:
                raise BadInputError(
                    f"{name} has shape {matrix.shape}; give {shape}, to match the other matrices"
                )
            object.__setattr__(self, name, matrix)
        if 0 in (n, m):
            raise BadInputError(
                "the plant has no state or no input u; give at least one state and one input"
            )
        _check_rank("D12", self.D12, "column", "every u needs its own cost in z")
        if p:
            _check_rank("D21", self.D21.T, "row", "every y needs its own noise from w")

    @cached_property
    def sides(self) -> tuple[Side, ...]:
        """The control side and, with measurements, the filter side of the problem."""
        control = Side(self.A, self.B1, self.B2, self.C1, self.D11, self.D12)
        if not len(self.C2):
            return (control,)
        return control, Side(self.A.T, self.C1.T, self.C2.T, self.B1.T, self.D11.T, self.D21.T)

    @property
    def floor(self) -> float:
        """Lower bound of δ due to D11: the gain of D11 that no controller can reduce."""
        if not len(self.C2):
            return float(np.linalg.norm(self.D11, 2)) if self.D11.size else 0.0
        return max(side.feedthrough for side in self.sides)

    @classmethod
    def measured(
        cls, game: Game, C: np.ndarray, V: np.ndarray, D: np.ndarray | None = None
    ) -> GeneralizedPlant:
        """Return the generalized plant of a game with measurements y = C x + D u + n of its state
        x.

        n is noise of intensity V. The disturbance of the plant is w = (d, v), where d is the
        disturbance of the game and n = V^½ v. The cost of the plant is z = (Q^½ x, R^½ u), or with
        cross weights N z = ((Q - N R⁻¹ N')^½ x, R^½ (u + R⁻¹ N' x)). For δ = inf, the controller is
        the LQG controller.

        C: (p, n)
        D: (p, m), or None for 0
        V: (p, p)

        Raises BadInputError if V is not positive definite or a shape is wrong.
        """
        V = checked_matrix("V", V, LARGEST)
        check_definite("V", V, strictly=True)
        n, m = game.B.shape
        k = game.E.shape[1]
        p = len(V)
        root = square_root(game.R)
        return cls(
            A=game.A,
            B1=np.hstack([game.E, np.zeros((n, p))]),
            B2=game.B,
            C1=np.vstack([scaled_root(game.without_cross_weights.Q).T, root @ game.F]),
            D12=np.vstack([np.zeros((n, m)), root]),
            C2=C,
            D21=np.hstack([np.zeros((p, k)), square_root(V)]),
            D22=D,
        )

    def transposed(self) -> GeneralizedPlant:
        """Return the dual plant. Its controller is the transpose of this plant's controller."""
        return GeneralizedPlant(
            self.A.T,
            self.C1.T,
            self.C2.T,
            self.B1.T,
            self.D21.T,
            self.B2.T,
            self.D12.T,
            self.D11.T,
            self.D22.T,
        )

    @classmethod
    def from_control(cls, system: Any, measurements: int, inputs: int) -> GeneralizedPlant:
        """Return the generalized plant of a state-space system, partitioned as in `hinfsyn`.

        system: object with the matrices A, B, C and D
        measurements: number of outputs y, which are the last outputs of the system
        inputs: number of inputs u, which are the last inputs of the system
        """
        A, B, C, D = (np.asarray(getattr(system, name), dtype=float) for name in "ABCD")
        r = len(C) - measurements
        k = B.shape[1] - inputs
        return cls(A, B[:, :k], B[:, k:], C[:r], D[:r, k:], C[r:], D[r:, :k], D[:r, :k], D[r:, k:])

    def in_axes(self, axes: Axes) -> GeneralizedPlant:
        """Return the plant in other coordinates of its state."""
        return replace(
            self,
            A=axes.square(self.A),
            B1=axes.rows(self.B1),
            B2=axes.rows(self.B2),
            C1=axes.columns(self.C1),
            C2=axes.columns(self.C2),
        )

    @cached_property
    def axes(self) -> Axes:
        """Balanced coordinates that separate fast and slow states, used in all computations."""
        axes = Axes.of(self.A)
        control = self.in_axes(axes).sides[0]
        return axes.scaled(NormalForm.of(control.game(math.inf)).units)

    @cached_property
    def apart(self) -> GeneralizedPlant:
        """The plant in the coordinates `axes`."""
        return self.in_axes(self.axes)

    def minimum_delta(self) -> DeltaMin:
        """Return the smallest δ for which a controller exists, with the condition that fails below
        it.

        The relative accuracy is `TOLERANCE`. Raises NoSolutionError if no δ permits a controller,
        or if rounding hides whether a controller exists.
        """
        check_modes(self)
        begin = max(1.0, 2.0 * self.floor)
        gain = _gain_of_optimal_loop(self.apart)
        if 0.0 < gain < math.inf:
            begin = 2.0 * gain
        value, refused, ending = smallest_delta(
            lambda delta: conditions(self, delta), begin, TOLERANCE
        )
        return DeltaMin(value, refused, ending.condition or "none")


def stored_plant(
    path: str | Path, found: dict[str, Any] | None = None
) -> tuple[GeneralizedPlant, float | None, tuple[str, ...]]:
    """Return the generalized plant in a file, its delta or None, and notes on unused entries.

    The file contains A, B1, B2, C1, D12 and optionally C2, D21, D11, D22 and delta.

    found: entries of the file if they have been read already, else None

    Raises BadInputError if the file cannot be read, an entry is missing or invalid, or delta is not
    positive.
    """
    names = [field.name for field in fields(GeneralizedPlant)]
    with prefix_errors(path):
        stored, notes = entries_of(read_arrays(path) if found is None else found, {"A", "B2"})
        unused = sorted(
            set(stored) - {*names, "delta", "states", "inputs", "state_units", "input_units"}
        )
        notes += [f"not used: {shortened(', '.join(unused), 200)}"] if unused else []
        entries: dict[str, Any] = {name: stored.get(name) for name in names}
        plant = GeneralizedPlant(**entries)
        delta = one_number("delta", stored["delta"]) if "delta" in stored else None
        if delta is not None and delta != math.inf:
            refuse_unless_positive("delta", delta)
    return plant, delta, tuple(f"{path}: {note}" for note in notes)


def _check_rank(name: str, matrix: np.ndarray, kind: str, needed: str) -> None:
    sizes = np.linalg.norm(matrix, axis=0)
    empty = np.flatnonzero(sizes == 0.0)
    if empty.size:
        raise BadInputError(
            f"{name} has only zeros in {kind} {empty[0] + 1}: {needed}; add a nonzero entry"
        )
    rank = np.linalg.matrix_rank(matrix / sizes, rtol=RANK)
    if rank < matrix.shape[1]:
        raise BadInputError(
            f"{name} has rank {rank}, but {matrix.shape[1]} {kind}s: {needed}; make the"
            f" {kind}s independent"
        )


@dataclass(frozen=True, eq=False, repr=False)
class OutputFeedback(Reported):
    """Certified controller x̂' = Ak x̂ + Bk y, u = Ck x̂ + Dk y.

    Ak: (n, n)
    Bk: (n, p)
    Ck: (m, n)
    Dk: (m, p)
    X: (n, n), stabilizing solution of the control equation
    Y: (n, n), stabilizing solution of the filter equation
    delta: upper bound of the gain from w to z
    coupling: ρ(X Y) / δ², below 1
    checks: checks of the certificates of both equations, of the coupling, of the closed loop, and
      of the agreement with the controller derived from the transposed plant
    """

    Ak: Matrix
    Bk: Matrix
    Ck: Matrix
    Dk: Matrix
    X: Matrix
    Y: Matrix
    delta: float
    coupling: float
    checks: tuple[Check, ...]


@dataclass(frozen=True, eq=False, repr=False)
class StateFeedback(Reported):
    """Certified gain of a plant whose states are measured.

    P: (n, n), stabilizing solution
    K: (m, n), gain, u = -K x
    disturbance_gain: L, (k, n), worst disturbance w = L x
    delta: upper bound of the gain from w to z
    checks: checks of the certificate and of the closed loop
    """

    P: Matrix
    K: Matrix
    disturbance_gain: Matrix
    delta: float
    checks: tuple[Check, ...]


@checks_arguments
def solve_plant(plant: GeneralizedPlant, delta: float) -> OutputFeedback | StateFeedback:
    """Return the certified central controller with ‖z‖ < δ ‖w‖, or without C2 the gain K.

    Without cross terms (D12'C1 = 0, B1 D21' = 0) and with D11 = 0:

      A'X + XA + C1'C1 - X (B2 R⁻¹B2' - δ⁻²B1 B1') X = 0
      Y: the same equation for the transposed plant
      Ck = -R⁻¹B2'X
      Bk = (I - δ⁻² Y X)⁻¹ Y C2'V⁻¹
      Ak = A + δ⁻²B1 B1'X + B2 Ck - Bk C2
      R = D12'D12,  V = D21 D21'

    A controller exists if δ is above the gain of D11 that no controller can reduce, X >= 0 and Y >=
    0 stabilize, and ρ(XY) < δ². Source: Doyle, Glover, Khargonekar, Francis, IEEE Trans. Automatic
    Control 34 (1989), 831-847, Theorem 3.

    Raises NoSolutionError if there is no certified controller. The message names the failed
    condition with delta_min, the mode that violates an assumption, or the failed check.
    """
    check_modes(plant)
    try:
        return _certified(plant, delta)
    except NoSolutionError as failure:
        raise NoSolutionError(f"{failure}; {plant.minimum_delta().advice(delta)}") from failure


def _certified(plant: GeneralizedPlant, delta: float) -> OutputFeedback | StateFeedback:
    """Return the certified solution for one δ."""
    answer = conditions(plant, delta)
    if not answer.exists:
        raise NoSolutionError(f"the {answer.condition} fails: {answer.reason}")
    values: list[np.ndarray] = []
    checks: list[Check] = []
    for side, name in zip(plant.apart.sides, ("control", "filter"), strict=False):
        try:
            solution = certified_solution(NormalForm.of(side.game(delta)))
        except NoSolutionError as error:
            raise NoSolutionError(f"the {name} Riccati equation: {error}") from error
        values.append(solution.form.value(solution.X))
        for check in solution.certificate.checks:
            checks.append(replace(check, name=f"{name}_{check.name}"))
    result: OutputFeedback | StateFeedback
    if len(plant.C2):
        result = _output_feedback(plant, values[0], values[1], delta)
    else:
        result = _state_feedback(plant, values[0], delta)
    for check in result.checks:
        if not check.ok:
            raise NoSolutionError(f"the controller is not certified: {check.reason}")
    return replace(result, checks=(*checks, *result.checks))


def _state_feedback(plant: GeneralizedPlant, X: np.ndarray, delta: float) -> StateFeedback:
    """Return the certified gain for a solution X of the control equation."""
    axes = plant.axes
    apart = plant.apart
    L, F = apart.sides[0].policies(X, delta)
    K = -axes.columns_back(F)
    F = -axes.columns(K)  # includes the rounding of K
    checks = loop_checks(
        apart.A + apart.B2 @ F, apart.B1, apart.C1 + apart.D12 @ F, apart.D11, delta
    )
    return StateFeedback(axes.value_back(X), K, axes.columns_back(L), delta, checks)


def _output_feedback(
    plant: GeneralizedPlant, X: np.ndarray, Y: np.ndarray, delta: float
) -> OutputFeedback:
    """Return the central controller for solutions X and Y, with its checks."""
    axes = plant.axes
    apart = plant.apart
    radius = spectral_radius(X @ Y)
    controller = central_controller(apart, X, Y, delta)
    A, B, C, D = central_controller(apart.transposed(), Y, X, delta)
    difference = _response_difference(controller, (A.T, C.T, B.T, D.T))
    apart_by = f"the two derivations of the controller differ by {difference:.2g} of their response"
    A, B, C, Dk = controller
    Ak = axes.square_back(A)
    Bk = axes.rows_back(B)
    Ck = axes.columns_back(C)
    rounded = (axes.square(Ak), axes.rows(Bk), axes.columns(Ck), Dk)
    checks = (
        below("coupling", radius, delta**2, f"rho(XY) = {radius:.6g} is not below delta^2"),
        *loop_checks(*closed_plant(apart, rounded), delta),
        at_most("derivations_agree", difference, DERIVATIONS_AGREE, apart_by),
    )
    return OutputFeedback(
        Ak=Ak,
        Bk=Bk,
        Ck=Ck,
        Dk=Dk,
        X=axes.value_back(X),
        Y=axes.dual_value_back(Y),
        delta=delta,
        coupling=radius / delta**2,
        checks=checks,
    )


def central_controller(
    plant: GeneralizedPlant, X: np.ndarray, Y: np.ndarray, delta: float
) -> Controller:
    """Return the central controller for given X and Y, without a certificate.

    With F1, F2 of X, L1, L2 of Y, Z = (I - δ⁻² Y X)⁻¹ and D22 = 0:

      Ck = F2 - Dk (C2 + D21 F1),  Bk = Z ((B2 + L1 D12) Dk - L2),
      Ak = A + B1 F1 + B2 F2 - Bk (C2 + D21 F1)

    Dk is that of `_feedthrough`. Raises NoSolutionError if the algebraic loop with D22 has no
    solution.
    """
    control, filter_ = plant.sides
    F1, F2 = control.policies(X, delta)
    L1, L2 = (each.T for each in filter_.policies(Y, delta))
    seen = plant.C2 + plant.D21 @ F1
    Dk = _feedthrough(plant, delta)
    Bk = np.linalg.solve(np.eye(len(X)) - Y @ X / delta**2, (plant.B2 + L1 @ plant.D12) @ Dk - L2)
    Ak = plant.A + plant.B1 @ F1 + plant.B2 @ F2 - Bk @ seen
    Ck = F2 - Dk @ seen
    # The direct effect of u on y is known and is subtracted.
    known = np.eye(len(Dk)) + Dk @ plant.D22
    if np.linalg.cond(known) > 1.0 / RANK:
        raise NoSolutionError(
            "the central controller and D22 form an algebraic loop without a solution; change delta"
        )
    Ck = np.linalg.solve(known, Ck)
    Dk = np.linalg.solve(known, Dk)
    return Ak - Bk @ plant.D22 @ Ck, Bk - Bk @ plant.D22 @ Dk, Ck, Dk


def _feedthrough(plant: GeneralizedPlant, delta: float) -> np.ndarray:
    """Return Dk of the central controller: the gain of D11 + D12 Dk D21 is below δ."""
    # In orthonormal coordinates of z and w, D11 = [[a, b], [c, d]], where u and y reach only the
    # block d. This block of D12 Dk D21 is -d - c a' (δ² I - a a')⁻¹ b.
    m = plant.D12.shape[1]
    p = len(plant.D21)
    (U, R), (V, S) = (np.linalg.qr(each, mode="complete") for each in (plant.D12, plant.D21.T))
    D = U.T @ plant.D11 @ V
    a = D[m:, p:]
    b = D[m:, :p]
    c = D[:m, p:]
    d = D[:m, :p]
    inner = -d - c @ a.T @ np.linalg.solve(np.eye(len(a)) - a @ a.T / delta**2, b) / delta**2
    return np.asarray(np.linalg.solve(R[:m], np.linalg.solve(S[:p], inner.T).T))


@checks_arguments
def closed_plant(plant: GeneralizedPlant, controller: Controller) -> Controller:
    """Return A, B, C, D from w to z of the closed loop, with the states [x; x̂]."""
    Ak, Bk, Ck, Dk = controller
    n = np.linalg.inv(np.eye(len(Dk)) - Dk @ plant.D22)
    u = np.hstack([n @ Dk @ plant.C2, n @ Ck])  # u and y as functions of the states, then of w
    y = np.hstack([plant.C2, np.zeros((len(plant.C2), len(Ak)))]) + plant.D22 @ u
    u_w = n @ Dk @ plant.D21
    y_w = plant.D21 + plant.D22 @ u_w
    A = np.vstack([plant.B2 @ u, Bk @ y])
    A[: len(plant.A), : len(plant.A)] += plant.A
    A[len(plant.A) :, len(plant.A) :] += Ak
    C = plant.D12 @ u
    C[:, : len(plant.A)] += plant.C1
    return A, np.vstack([plant.B1 + plant.B2 @ u_w, Bk @ y_w]), C, plant.D11 + plant.D12 @ u_w


def loop_checks(
    A: np.ndarray, B: np.ndarray, C: np.ndarray, D: np.ndarray, delta: float
) -> tuple[Check, ...]:
    """Return the checks of a closed loop A, B, C, D: stability and, for δ < inf, a gain below δ."""
    abscissa = abscissa_of(A)
    found = [
        below(
            "closed_loop_abscissa",
            abscissa,
            0.0,
            f"the closed loop has a pole at {abscissa:.3g} 1/s",
        )
    ]
    if math.isfinite(delta):
        kept = abscissa < 0.0 and system_gain(A, B, C, D) < delta
        reason = f"the closed loop's gain from disturbance to cost is not below delta = {delta:.6g}"
        found.append(at_most("gain_above_delta", 0.0 if kept else 1.0, 0.0, reason))
    return tuple(found)


def _gain_of_optimal_loop(plant: GeneralizedPlant) -> float:
    """Return an upper bound of δ_min: the L2 gain from w to z with the H2-optimal controller."""
    forms = [NormalForm.of(side.game(math.inf)) for side in plant.sides]
    try:
        values = [form.value(form.unrefined()) for form in forms]
    except NoSolutionError:
        return math.inf
    if len(values) == 1:
        _, F = plant.sides[0].policies(values[0], math.inf)
        loop = (plant.A + plant.B2 @ F, plant.B1, plant.C1 + plant.D12 @ F, plant.D11)
    else:
        loop = closed_plant(plant, central_controller(plant, values[0], values[1], math.inf))
    return system_gain(*loop)


def check_modes(plant: GeneralizedPlant) -> None:
    """Raise NoSolutionError unless both Riccati equations can have a stabilizing solution.

    Every mode that is not stable must be controllable by u and observable in y. Neither the path
    from u to z nor that from w to y may have a zero on the imaginary axis. The message names the
    mode or the zero.
    """
    for side, sentences in zip(plant.sides, _OBSTACLES, strict=False):
        found = NormalForm.of(side.game(math.inf)).obstacle(*sentences)
        if found:
            raise NoSolutionError(found)


def _response_difference(one: Controller, other: Controller) -> float:
    """Return the largest |K1(jω) - K2(jω)| / |K1(jω)| over a grid of frequencies."""
    poles = np.abs(np.linalg.eigvals(one[0]))
    grid = np.geomspace(1e-2 * max(poles.min(), 1e-6), 1e2 * poles.max(), 60)
    first, second = (C @ responses(A, B, grid) + D for A, B, C, D in (one, other))
    difference = np.linalg.norm(first - second, axis=(1, 2))
    size = np.linalg.norm(first, axis=(1, 2))
    relative = difference / np.where(size > 0.0, size, 1.0)
    return float(relative.max())


_EQUATIONS = ("control Riccati equation", "filter Riccati equation")


def conditions(plant: GeneralizedPlant, delta: float) -> Answer:
    """Return whether the conditions for a controller are satisfied, and the first violated
    condition.

    The conditions are evaluated without certificates. Source: Zhou, Doyle and Glover, Theorem 17.1.
    """
    if not delta > plant.floor:
        reason = f"D11 alone causes a gain of {plant.floor:.6g} under every controller"
        return Answer(False, reason, "feedthrough condition")
    forms = [NormalForm.of(side.game(delta)) for side in plant.apart.sides]
    for form, equation in zip(forms, _EQUATIONS, strict=False):
        answer = form.existence()
        if not answer.exists:
            return answer._replace(condition=equation)
    if len(forms) == 1 or math.isinf(delta):
        return Answer(True)
    try:
        X, Y = (form.value(form.by_schur()) for form in forms)
    except NoSolutionError as error:
        return Answer(False, str(error), COUPLING, is_rounding=True)
    radius = spectral_radius(X @ Y)
    reason = f"rho(XY) = {radius / delta**2:.6g} delta^2"
    return Answer(radius < delta**2, reason, COUPLING, 1.0 - radius / delta**2)
