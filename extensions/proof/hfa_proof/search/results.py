"""Results of `hfa prove`, as written in JSON. Each entry is declared once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from hfa_aircraft.model import Model
from hfa_aircraft.signals import StatesAndInputs
from hfa_proof.checker.statement import ModelsStatement
from hfa_support.reporting.results import Matrix, Result, Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofData(Result):
    """Result of a proof or a check. null means open. Fields that a kind does not have are omitted.

    statement: schedule, solution, critic or check.
    dynamics: published, newton, or the name of another model.
    dihedral_deg: interval of the dihedral angle, degrees.
    proved: whether the full claim is proved.
    one_branch: whether the trims of all boxes are on one branch.
    decay_rate: proved decay rate where the loop is stable, 1/s.
    loop: intervals with the number of unstable modes of the loop, and open intervals.
    modes: intervals with the number of unstable modes of A, and open intervals with bounds of the
        number.
    refuted: intervals where the loop is proved unstable.
    not_covered: effects that the statement does not cover.
    boxes: enclosures of A and B, or the number of boxes.
    source: SHA-256 of the files of another aircraft, for a checked certificate.
    P: matrix of the value z'P z.
    delta: disturbance weight, null without a disturbance.
    scheduled: scheduling variable -> interval, for another aircraft.
    dihedral_rate_deg_s: proved rate of the dihedral angle, deg/s, with --rate.
    scheduled_rate: proved rate of the scheduling variable, per second, with --rate for another
        aircraft.
    actuators: bandwidth, effectiveness and delay, with --bandwidth.
    lyapunov: Lyapunov function for a moving scheduling variable, with --rate.
    kind: schedule, game or models, for a checked certificate.
    parameters: name of the parameter set, or the parameters, for a checked certificate.
    parameter_hash: hash of the parameters, for a checked certificate.
    written: version, command and date in the file, not verified, for a checked certificate.
    statement_sha256: SHA-256 of the JSON text of the statement, for a checked certificate.
    claim: every field of the statement, for a checked certificate.
    not_given: fields that were not compared, because no option gave them, for a checked
        certificate.
    limits: lowest and highest value of each limited signal of the trims, for a checked certificate.
    spread: half-widths of the parameters, for a checked certificate.
    game: Q, R, E and delta, for a checked certificate.
    error: proved bounds of the interpolation errors, for checked models.
    nodes: number of breakpoints, for checked models.
    relative_radius: relative radius of the enclosure of P.
    positive_definite: whether P is proved positive definite.
    worst_case_hurwitz: whether A - S P is proved Hurwitz.
    closed_loop_hurwitz: true if A - B K is proved Hurwitz, false if proved not Hurwitz.
    delta_min_above: proved lower bound of delta_min.
    delta_min_at_most: proved upper bound of delta_min.
    unstable_modes: number of unstable modes of A, null if only bounds are proved.
    unstable_modes_between: lowest and highest number of unstable modes of A.
    distances: part of the critic -> bounds of its relative distance, at_least and at_most.
    """

    schema = "hfa.proof/1"
    made_by = "hfa prove"

    statement: str
    dynamics: str | None = None
    dihedral_deg: Vector | None = None
    proved: bool | None = None
    one_branch: bool | None = None
    decay_rate: float | None = None
    loop: Any = None
    modes: Any = None
    refuted: Sequence[Mapping[str, Any]] | None = None
    not_covered: str | None = None
    boxes: Any = None
    source: str | None = None
    P: Matrix | None = None
    delta: float | None = None
    scheduled: Mapping[str, Any] | None = None
    dihedral_rate_deg_s: float | None = None
    scheduled_rate: float | None = None
    actuators: Mapping[str, Any] | None = None
    lyapunov: Mapping[str, Any] | None = None
    kind: str | None = None
    parameters: Any = None
    parameter_hash: str | None = None
    written: Mapping[str, Any] | None = None
    statement_sha256: str | None = None
    claim: Mapping[str, Any] | None = None
    not_given: Sequence[str] | None = None
    limits: Mapping[str, Any] | None = None
    spread: Mapping[str, Any] | None = None
    game: Mapping[str, Any] | None = None
    error: Mapping[str, float] | None = None
    nodes: int | None = None
    relative_radius: float | None = None
    positive_definite: Any = None
    worst_case_hurwitz: Any = None
    closed_loop_hurwitz: Any = None
    delta_min_above: float | None = None
    delta_min_at_most: float | None = None
    unstable_modes: Any = None
    unstable_modes_between: Vector | None = None
    distances: Mapping[str, Any] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class InterpolatedModels(StatesAndInputs, Result):
    """Linear models that are interpolated within a proved bound of the error.

    statement: the models and their bounds.
    tolerance: the largest error that the user permits.
    """

    schema = "hfa.lpv/1"
    made_by = "hfa prove models"
    json_keys = (
        "dynamics=model.name tolerance error=statement.errors dihedral_deg? A=statement.A "
        "B=statement.B K=statement.K inputs_offset states=state_names inputs=input_names "
        "state_units input_units scheduled?"
    )

    statement: ModelsStatement
    tolerance: float

    @property
    def model(self) -> Model:
        """The aircraft whose models are interpolated."""
        return self.statement.flight.model

    @property
    def dihedral_deg(self) -> Vector | None:
        """Breakpoints of the dihedral angle, degrees, or None for another aircraft."""
        return self.statement.breakpoints if self.model.extras.names_schedule else None

    @property
    def scheduled(self) -> Mapping[str, Vector] | None:
        """Scheduling variable -> breakpoints, or None for the flexible aircraft of the paper."""
        if self.model.extras.names_schedule:
            return None
        return {self.model.schedule: self.statement.breakpoints}

    @property
    def inputs_offset(self) -> Matrix:
        """Trim inputs U0 at each breakpoint, (g, m)."""
        return self.statement.inputs[..., 0]

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in the order of A."""
        return self.model.linear


@dataclass(frozen=True, kw_only=True, eq=False)
class CertificateData(Result):
    """Content of the file of a certificate.

    kind: schedule, game, models, region, region-boxes or cost-boxes.
    toolchain: version of the program that wrote the file.
    statement: the claim.
    witness: data for the proof.
    digest: SHA-256 of the text before this entry, equal for equal proofs.
    checksum: SHA-256 of the text before this entry, including the provenance.
    """

    schema = "hfa.certificate/9"
    made_by = "hfa prove -o FILE.json: the certificate"

    kind: Literal["schedule", "game", "models", "region", "region-boxes", "cost-boxes"]
    toolchain: str
    statement: Mapping[str, Any]
    witness: Mapping[str, Any]
    digest: str
    checksum: str
