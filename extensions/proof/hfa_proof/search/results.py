"""Results of `hfa prove`, with each entry declared once."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Literal

from hfa_aircraft.model import Model
from hfa_aircraft.states_and_inputs import StatesAndInputs
from hfa_proof.checker.statement import ModelsStatement
from hfa_support.reporting.results import Matrix, Result, Vector


@dataclass(frozen=True, kw_only=True, eq=False)
class ProofData(Result):
    """The result of a proof or a check, as keys of dicts: null means open, and entries that
    a kind does not have are omitted.

    statement: schedule, solution, critic or check.
    dynamics: published or newton, or the name of another model.
    dihedral_deg: interval, degrees.
    proved: whether everything is proved.
    one_branch: whether the trims of all boxes are one branch.
    decay_rate: 1/s.
    loop: runs of angles with their unstable modes, A - B K, and open intervals.
    modes: runs of angles with the unstable modes of A; open: the least and the most.
    refuted: where it is proved unstable.
    not_covered: effects that the statement does not cover.
    boxes: enclosures, or their number.
    source: of a checked certificate of another aircraft: SHA-256 of its files.
    P: value z' P z.
    delta: disturbance weight, null for none.
    scheduled: of another aircraft: scheduling variable -> interval.
    dihedral_rate_deg_s: with --rate.
    scheduled_rate: of another aircraft: with --rate, per second.
    actuators: with --bandwidth: bandwidth, effectiveness, delay.
    lyapunov: with --rate.
    kind: of a checked certificate: schedule, game or models.
    parameters: of a checked certificate: the covered set.
    parameter_hash: of a checked certificate.
    written: of a checked certificate: version, command and date in the file; not verified.
    statement_sha256: of a checked certificate: SHA-256 of the JSON text of its statement.
    claim: of a checked certificate: its statement, every field.
    not_given: of a checked certificate: fields that no option gave and that were not compared.
    limits: of a checked certificate: lowest and highest value of each input and unknown of the
        trims.
    spread: of a checked certificate: half widths of the parameters.
    game: of a checked certificate: Q, R, E, delta.
    error: of checked models: proved bounds.
    nodes: of checked models.
    relative_radius: of the enclosure of P.
    positive_definite: true, false or null for open.
    worst_case_hurwitz: A - S P.
    closed_loop_hurwitz: A - B K.
    delta_min_above: proved lower end.
    delta_min_at_most: proved upper end.
    unstable_modes: of A, null where they are not counted.
    unstable_modes_between: the least and the most.
    distances: P, K -> at_least, at_most.
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
    """Linear models that interpolate within a proved bound.

    statement: the models and their bounds
    tolerance: the requested bound.
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
        """Name of the aircraft."""
        return self.statement.flight.model

    @property
    def dihedral_deg(self) -> Vector | None:
        """Breakpoints of the dihedral angle, degrees, or None for another aircraft."""
        return self.statement.breakpoints if self.model.extras.names_schedule else None

    @property
    def scheduled(self) -> Mapping[str, Vector] | None:
        """Return scheduling variable -> breakpoints for an aircraft other than the HFA, else
        None."""
        if self.model.extras.names_schedule:
            return None
        return {self.model.schedule: self.statement.breakpoints}

    @property
    def inputs_offset(self) -> Matrix:
        """Inputs U0 at each breakpoint, (G, m)."""
        return self.statement.inputs[..., 0]

    @property
    def state_names(self) -> tuple[str, ...]:
        """Names of the states, in order."""
        return self.model.linear


@dataclass(frozen=True, kw_only=True, eq=False)
class CertificateData(Result):
    """The file of a certificate, as keys of a text that contains digests of itself.

    kind: schedule, game, models, region, region-boxes or cost-boxes.
    toolchain: version that wrote it.
    statement: the claim, declared in extensions/proof/hfa_proof/checker/statement.py.
    witness: the evidence, declared in extensions/proof/hfa_proof/checker/witness.py.
    digest: SHA-256 of the text before it, equal for equal proofs.
    checksum: SHA-256 of the text before it, provenance included.
    """

    schema = "hfa.certificate/9"
    made_by = "hfa prove -o FILE.json: the certificate"

    kind: Literal["schedule", "game", "models", "region", "region-boxes", "cost-boxes"]
    toolchain: str
    statement: Mapping[str, Any]
    witness: Mapping[str, Any]
    digest: str
    checksum: str
