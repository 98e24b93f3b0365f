"""Results of `hfa prove`, as written in JSON. Each entry is declared once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Any, Literal, NamedTuple

import numpy as np

from hfa_aircraft.model import Model
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.loop import Loop, stored_policy
from hfa_prove.statements.plant import Plant
from hfa_prove.statements.region import RegionStatement
from hfa_prove.statements.schedule import Run, ScheduleStatement, UncertainActuators
from hfa_prove.statements.value import ValueStatement
from hfa_prove.words import ProvedResult
from hfa_support.reporting.results import Matrix, Result, Vector, given


@dataclass(frozen=True, kw_only=True, eq=False)
class ScheduleProof(Result):
    """Proof about a schedule. Entries that do not apply to the aircraft or the options are omitted.

    statement: schedule.
    dynamics: published, newton, or the name of another model.
    dihedral_deg: interval of the dihedral angle, degrees.
    scheduled: scheduling variable -> interval, for another aircraft.
    proved: whether the full claim is proved.
    one_branch: whether the trims of all boxes are on one branch.
    decay_rate: proved decay rate where the loop is stable, 1/s.
    loop: intervals with the number of unstable modes of the loop, open intervals, and number of
        boxes.
    modes: intervals with the number of unstable modes of A, open intervals with bounds of the
        number, and number of boxes.
    refuted: intervals where the loop is proved unstable.
    not_covered: effects that the statement does not cover.
    boxes: enclosures of A and B.
    actuators: bandwidth, effectiveness and delay, with --bandwidth.
    dihedral_rate_deg_s: proved rate of the dihedral angle, deg/s, with --rate.
    scheduled_rate: proved rate of the scheduling variable, per second, with --rate for another
        aircraft.
    lyapunov: Lyapunov function for a moving scheduling variable, with --rate.
    """

    schema = "hfa.proof-schedule/1"

    statement: Literal["schedule"]
    dynamics: str
    dihedral_deg: Vector | None = None
    scheduled: Mapping[str, Any] | None = None
    proved: bool
    one_branch: bool
    decay_rate: float
    loop: Mapping[str, Any]
    modes: Mapping[str, Any]
    refuted: Sequence[Mapping[str, Any]]
    not_covered: str
    boxes: Any
    actuators: Mapping[str, Any] | None = None
    dihedral_rate_deg_s: float | None = None
    scheduled_rate: float | None = None
    lyapunov: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class GameProof(Result):
    """Proof about the solution of a game or about a critic. null means open.

    A proof about a critic has the entries `statement`, `proved`, `closed_loop_hurwitz` and
    `distances`. A proof about a solution has all entries but `distances`.

    statement: solution or critic.
    proved: whether the full claim is proved.
    closed_loop_hurwitz: true if A - B K is proved Hurwitz, false if proved not Hurwitz.
    distances: part of the critic -> bounds of its relative distance, at_least and at_most.
    P: matrix of the value z'P z.
    relative_radius: relative radius of the enclosure of P.
    positive_definite: whether P is proved positive definite.
    worst_case_hurwitz: whether A - S P is proved Hurwitz.
    delta: disturbance weight, null without a disturbance.
    delta_min_above: proved lower bound of delta_min.
    delta_min_at_most: proved upper bound of delta_min.
    unstable_modes: number of unstable modes of A, null if only bounds are proved.
    unstable_modes_between: lowest and highest number of unstable modes of A.
    """

    schema = "hfa.proof-game/1"

    statement: Literal["solution", "critic"]
    proved: bool
    closed_loop_hurwitz: bool | None
    distances: Mapping[str, Any] | None = None
    P: Matrix | None = None
    relative_radius: float | None = None
    positive_definite: bool | None = None
    worst_case_hurwitz: bool | None = None
    delta: float | None = None
    delta_min_above: float | None = None
    delta_min_at_most: float | None = None
    unstable_modes: int | None = None
    unstable_modes_between: Vector | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofCheck(Result):
    """Verified certificate of a schedule or a game, with the entries of its kind.

    statement: check.
    kind: schedule or game.
    boxes: number of boxes of the proof.
    written: version, command and date in the file, not verified.
    statement_sha256: SHA-256 of the JSON text of the statement.
    claim: every entry of the statement.
    not_given: entries that were not compared, because no option gave them.
    proved: whether the full claim is proved.
    dynamics: published, newton, or the name of another model.
    dihedral_deg: interval of the dihedral angle, degrees.
    scheduled: scheduling variable -> interval, for another aircraft.
    source: SHA-256 of the files of another aircraft.
    parameters: name of the parameter set, or the parameters.
    parameter_hash: hash of the parameters.
    limits: lowest and highest value of each limited signal of the trims.
    spread: half-widths of the parameters.
    one_branch: whether the trims of all boxes are on one branch.
    decay_rate: proved decay rate where the loop is stable, 1/s.
    loop: intervals with the number of unstable modes of the loop, and open intervals.
    modes: intervals with the number of unstable modes of A, and open intervals.
    refuted: intervals where the loop is proved unstable.
    not_covered: effects that the statement does not cover.
    actuators: bandwidth, effectiveness and delay.
    dihedral_rate_deg_s: proved rate of the dihedral angle, deg/s.
    scheduled_rate: proved rate of the scheduling variable of another aircraft, per second.
    game: Q, R, E and delta.
    distances: part of the critic -> lower and upper bound of its relative distance.
    closed_loop_hurwitz: whether A - B K is Hurwitz, null if this is open.
    delta_min_above: proved lower bound of delta_min.
    delta_min_at_most: proved upper bound of delta_min.
    unstable_modes_between: lowest and highest number of unstable modes of A.
    """

    schema = "hfa.proof-check/1"

    statement: Literal["check"]
    kind: Literal["schedule", "game"]
    boxes: int
    written: Mapping[str, Any]
    statement_sha256: str
    claim: Mapping[str, Any]
    not_given: Sequence[str]
    proved: bool
    dynamics: str | None = None
    dihedral_deg: Vector | None = None
    scheduled: Mapping[str, Any] | None = None
    source: str | None = None
    parameters: Any = None
    parameter_hash: str | None = None
    limits: Mapping[str, Any] | None = None
    spread: Mapping[str, Any] | None = None
    one_branch: bool | None = None
    decay_rate: float | None = None
    loop: Mapping[str, Any] | None = None
    modes: Mapping[str, Any] | None = None
    refuted: Sequence[Mapping[str, Any]] | None = None
    not_covered: str | None = None
    actuators: Mapping[str, Any] | None = None
    dihedral_rate_deg_s: float | None = None
    scheduled_rate: float | None = None
    game: Mapping[str, Any] | None = None
    distances: Mapping[str, Any] | None = None
    closed_loop_hurwitz: bool | None = None
    delta_min_above: float | None = None
    delta_min_at_most: float | None = None
    unstable_modes_between: Vector | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class CertificateData(Result):
    """Content of the file of a certificate.

    kind: schedule, game, region, cost or value.
    toolchain: version of the program that wrote the file.
    statement: the claim.
    witness: data for the proof.
    digest: SHA-256 of the text before this entry, equal for equal proofs.
    checksum: SHA-256 of the text before this entry, including the provenance.
    """

    schema = "hfa.certificate/10"

    kind: Literal["schedule", "game", "region", "cost", "value"]
    toolchain: str
    statement: Mapping[str, Any]
    witness: Mapping[str, Any]
    digest: str
    checksum: str


class Place(NamedTuple):
    """A level of V, and a state deviation from the equilibrium at that level."""

    V: float
    z: Mapping[str, float]


@dataclass(frozen=True, eq=False)
class ProvedRegion(ProvedResult):
    """Region of attraction, or set that is invariant under disturbances.

    statement: the proved statement.
    prover: method of the proof: `squares`, sums of squares, or `boxes`, branch and bound.
    size: number of boxes, or of parts of the set or of its boundary, on which V' < 0 is proved.
    reaches: state -> lowest and highest deviation in the set.
    """

    statement: RegionStatement
    prover: str
    size: int
    reaches: Mapping[str, tuple[float, float]]

    @property
    def subject(self) -> Loop:
        """The closed loop: model, trim, limits and policy."""
        return self.statement.loop

    @property
    def rho(self) -> float:
        """Level of V. The set is {V(z) <= rho}, with z the deviation from the equilibrium."""
        return self.statement.rho

    @property
    def policy(self) -> str | Mapping[str, Any]:
        """Coefficients of a polynomial policy, or the SHA-256 of the policy's instructions.

        The coefficients are K and the terms of q in u = sat(u0 - K (x - x0) + q(x - x0)), with the
        trim x0, u0.
        """
        return stored_policy(self.statement.loop.policy)

    @property
    def disturbances(self) -> Mapping[str, float]:
        """Disturbance -> its largest absolute value."""
        return self.statement.loop.disturbances

    @property
    def extents(self) -> Mapping[str, float]:
        """State -> upper bound of the absolute deviation in the set.

        The set is smaller than the box of these bounds.
        """
        return {name: max(-low, high) for name, (low, high) in self.reaches.items()}

    @property
    def terms(self) -> Sequence[Any]:
        """Terms of V = Σ coefficient z^exponents, as a list of [coefficient, exponents].

        They are rounded if the certificate contains V in other coordinates.
        """
        piece = self.statement.piece
        if np.array_equal(piece.M, np.eye(len(piece.M))):
            return self.statement.terms
        return PolynomialFunction.of_terms(piece.W.terms).substituted(piece.M).terms

    @property
    def degree(self) -> int:
        """Degree of V."""
        return self.statement.degree

    @property
    def P(self) -> Matrix | None:
        """Matrix P (n, n) of V = z'P z, or None if V has a degree above 2."""
        if self.degree > 2:
            return None
        return PolynomialFunction.of_terms(self.terms).matrix()

    @property
    def parts(self) -> int | None:
        """Number of parts of the set, or of its boundary, in a proof by sums of squares."""
        return self.size if self.prover == "squares" else None

    @property
    def boxes(self) -> int | None:
        """Number of boxes that a proof on boxes evaluated."""
        return self.size if self.prover == "boxes" else None

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "prover": self.prover,
            "proved": self.proved,
            "states": self.states,
            "state_units": self.state_units,
            "trim": self.trim,
            "parameters": self.parameters,
            "limits": self.limits,
            "rho": self.rho,
            "policy": self.policy,
            "disturbances": self.disturbances,
            "extents": self.extents,
            "terms": self.terms,
            "degree": self.degree,
        } | given(P=self.P, parts=self.parts, boxes=self.boxes)


@dataclass(frozen=True, eq=False)
class FoundRegion(ProvedRegion):
    """Set that a search has found and proved.

    origin: description of how V was found.
    decrease_fails_at: lowest level of V at which V' >= 0 was found, with the state, or None.
    leaves_limits_at: lowest level of V at an initial condition whose trajectory exceeds a limit,
        with the state, or None.
    lost_at: lowest level of V at an initial condition whose trajectory diverges or converges to
        another equilibrium, with the state, or None.
    limits_that_bind: signals whose limits the set nearly reaches.
    stopped: reason why no larger set is proved, or "".
    others: other prover that was tried -> what it proved, or why it proved nothing.
    """

    schema = "hfa.region/1"

    origin: str
    decrease_fails_at: Place | None
    leaves_limits_at: Place | None
    lost_at: Place | None
    limits_that_bind: Sequence[str]
    stopped: str = ""
    others: Mapping[str, str] = field(default_factory=dict)

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return super().contents() | {
            "origin": self.origin,
            "decrease_fails_at": self.decrease_fails_at,
            "leaves_limits_at": self.leaves_limits_at,
            "lost_at": self.lost_at,
            "limits_that_bind": self.limits_that_bind,
            "stopped": self.stopped,
            "others": self.others,
        }


@dataclass(frozen=True, eq=False)
class CheckedRegion(ProvedRegion):
    """Set that a certificate proves.

    written: version, command and date in the file, not verified.
    not_given: parts of the statement that were not compared, because no option gave them.
    """

    schema = "hfa.region-check/1"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return super().contents() | {"written": self.written, "not_given": self.not_given}


@dataclass(frozen=True, eq=False)
class BoundPiece(Result):
    """Lower bound of the cost by one polynomial W(M z), with z the deviation from the equilibrium.

    A flight that begins with |(M z)_i| < 1 for all i costs at least min(W(M z), c). A flight that
    begins elsewhere costs at least c.

    c: level.
    M: (n, n).
    coefficients: coefficients of the monomials of W.
    powers: (terms, n), powers of each monomial.
    boxes: number of boxes that the proof of the piece evaluated.
    """

    c: float
    M: Matrix
    coefficients: Vector
    powers: Sequence[Sequence[int]]
    boxes: int


@dataclass(frozen=True, eq=False)
class LowerBound(ProvedResult):
    """Proved lower bound of the cost of every flight to the equilibrium.

    statement: the proved statement.
    boxes: number of boxes that the proof of each piece evaluated.
    """

    statement: CostStatement
    boxes: Sequence[int]

    @property
    def subject(self) -> Plant:
        """The aircraft with its trim and limits."""
        return self.statement.plant

    @property
    def equilibrium(self) -> Mapping[str, float]:
        """State or input -> approximate value at the proved equilibrium."""
        return self.statement.equilibrium

    @property
    def Q(self) -> Matrix:
        """Weight of the states, (n, n)."""
        return self.statement.Q

    @property
    def R(self) -> Matrix:
        """Weight of the inputs, (m, m)."""
        return self.statement.R

    @property
    def pieces(self) -> Sequence[BoundPiece]:
        """Bounds by single polynomials. The cost is at least the largest of these bounds."""
        found = []
        for piece, boxes in zip(self.statement.pieces, self.boxes, strict=True):
            values = np.array([value for value, _ in piece.W.terms])
            powers = [powers for _, powers in piece.W.terms]
            found.append(BoundPiece(piece.c, piece.M, values, powers, boxes))
        return found

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "proved": self.proved,
            "states": self.states,
            "state_units": self.state_units,
            "trim": self.trim,
            "parameters": self.parameters,
            "limits": self.limits,
            "equilibrium": self.equilibrium,
            "Q": self.Q,
            "R": self.R,
            "pieces": self.pieces,
        }


@dataclass(frozen=True, eq=False)
class FoundLowerBound(LowerBound):
    """Lower bound that a search has found and proved.

    covered: share of the default initial conditions at which W of each piece is below its level.
    stopped: reason why no larger level is proved, or "" if every level that was tried is proved.
    """

    schema = "hfa.lower-bound/1"

    covered: Sequence[float]
    stopped: str

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return super().contents() | {"covered": self.covered, "stopped": self.stopped}


@dataclass(frozen=True, eq=False)
class CheckedLowerBound(LowerBound):
    """Lower bound that a certificate proves.

    written: version, command and date in the file, not verified.
    not_given: parts of the statement that were not compared, because no option gave them.
    """

    schema = "hfa.lower-bound-check/1"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return super().contents() | {"written": self.written, "not_given": self.not_given}


@dataclass(frozen=True, eq=False)
class ProvedValue(ProvedResult):
    """Proved value and policy of a nonlinear game about a trim, as polynomials.

    statement: the proved statement.
    rays: number of rays of the proof.
    """

    statement: ValueStatement
    rays: int

    @property
    def subject(self) -> Plant:
        """The aircraft with its trim."""
        return self.statement.plant

    @property
    def order(self) -> int:
        """Degree D of V; the policy has the degree D - 1."""
        return self.statement.order

    @property
    def residual(self) -> float:
        """Bound of every coefficient of the equation, relative to the sum of its terms."""
        return self.statement.residual

    @property
    def V(self) -> Vector:
        """Weights of all monomials of degree 2 to D, (M,), with the last index fastest."""
        return self.statement.V

    @property
    def u(self) -> Matrix:
        """Weights of u, (m, K), of all monomials of degree 1 to D - 1."""
        return self.statement.u

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return {
            "rays": self.rays,
            "proved": self.proved,
            "states": self.states,
            "state_units": self.state_units,
            "trim": self.trim,
            "parameters": self.parameters,
            "limits": self.limits,
            "order": self.order,
            "residual": self.residual,
            "W": self.V,
            "policy_weights": self.u,
        }


@dataclass(frozen=True, eq=False)
class FoundValue(ProvedValue):
    """Value that has been computed and proved."""

    schema = "hfa.proof-value/1"


@dataclass(frozen=True, eq=False)
class CheckedValue(ProvedValue):
    """Value that a certificate proves.

    written: version, command and date in the file, not verified.
    not_given: parts of the statement that were not compared, because no option gave them.
    """

    schema = "hfa.value-check/1"

    written: Mapping[str, str]
    not_given: Sequence[str] = ()

    def contents(self) -> dict[str, Any]:
        """Return the entries of the file, name -> value."""
        return super().contents() | {"written": self.written, "not_given": self.not_given}


Content = dict[str, Any]


def breakpoint_data(model: Model, breakpoints: Any) -> Content:
    """Return key -> scheduling values, as an entry of the data of a report.

    For the flexible aircraft, the entry is `dihedral_deg`. For another aircraft, the entry is
    `scheduled` and contains the name of the scheduling variable.
    """
    if model.about.names_schedule:
        return {model.schedule_key: breakpoints}
    return {"scheduled": {model.schedule: breakpoints}}


def schedule_data(statement: ScheduleStatement, moving: bool) -> Content:
    """Return the data of a statement about a schedule: proved, refuted and open intervals.

    moving: whether a rate of the scheduling variable is claimed
    """
    flight = statement.flight
    model = flight.model
    suffix = "_deg" if model.schedule_unit == "deg" else ""

    def ends(run: Run, **more: Any) -> Content:
        return {f"from{suffix}": run.low, f"to{suffix}": run.high} | more

    def counted(runs: Sequence[Run]) -> list[Content]:
        return [ends(run, unstable=run.least) for run in runs if run.least == run.most]

    refuted = [ends(run, unstable=run.least) for run in statement.loop if run.least > 0]
    still_open = [ends(run) for run in statement.loop if run.least == 0 < run.most]
    crossings = [
        ends(run, at_least=run.least, at_most=run.most)
        for run in statement.modes
        if run.least < run.most
    ]
    stable = not (refuted or still_open)
    one_branch = len(flight.trims) == 1
    data: Content = {
        "schema": ScheduleProof.schema,
        "statement": "schedule",
        "dynamics": model.name,
        **breakpoint_data(model, [flight.low, flight.high]),
        "proved": stable and one_branch and not (moving and statement.scheduled_rate is None),
        "one_branch": one_branch,
        "decay_rate": statement.decay_rate,
        "loop": {"proved": counted(statement.loop), "open": still_open},
        "modes": {"proved": counted(statement.modes), "open": crossings},
        "refuted": refuted,
        "not_covered": _not_covered(statement),
    }
    if isinstance(statement.actuators, UncertainActuators):
        names = ("bandwidth", "effectiveness", "delay")
        data["actuators"] = {name: getattr(statement.actuators, name) for name in names}
    if moving:
        key = f"{model.schedule}_rate_deg_s" if model.about.names_schedule else "scheduled_rate"
        data[key] = statement.scheduled_rate or 0.0
    return data


def _not_covered(statement: ScheduleStatement) -> str:
    others = "other actuators"
    if not isinstance(statement.actuators, UncertainActuators):
        others = "actuators outside the loop, delay"
    return (
        f"not covered: {others}, sampling of the states of a controller, a "
        f"{statement.flight.model.schedule} that the loop itself\nmoves, limits of the inputs, the "
        "nonlinear aircraft"
    )
