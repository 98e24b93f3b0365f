"""What a proof about a game says."""

from __future__ import annotations

import math

from hfa_model.reporting.report import Report
from hfa_model.reporting.text import Table, matrix_table
from verification.proof.proof_report import SCHEMA
from verification.proof.solution_proof import CriticProof, SolutionProof


def solution_proof_report(proof: SolutionProof, states: tuple[str, ...], origin: str) -> Report:
    """The verdict, the statements one by one, and the P that the radius is about."""
    enclosed, delta = proof.enclosed, proof.delta
    modes = "open: one may lie on the axis" if proof.unstable is None else str(proof.unstable)
    bracket = "open" if delta is None else f"above {delta.refused:.10g}, at most {delta.value:.10g}"
    rows = [
        ("the stabilizing solution exists and is unique", "proved" if enclosed.stabilizing else "open"),
        ("P is positive definite", "proved" if enclosed.is_value else "open"),
        ("A - S P is Hurwitz", "proved" if enclosed.stabilizing else "open"),
        ("A - B K is Hurwitz", "proved" if enclosed.stable else "open"),
        ("relative radius about the printed P", f"{proof.radius:.3g}"),
        ("delta_min", bracket),
        ("relative width of the bracket", "" if delta is None else f"{delta.width:.2g}"),
        ("no value below the bracket because", "" if delta is None else delta.reason),
        ("unstable modes of A", modes),
    ]
    return Report(
        title=f"{'Proved' if proof.proved else 'Left open'}: the solution of the game of {origin}",
        parts=[Table(("statement", "result"), rows), matrix_table("P", states, states, proof.P)],
        data={
            "schema": SCHEMA,
            "statement": "solution",
            "proved": proof.proved,
            "P": proof.P,
            "relative_radius": proof.radius,
            "positive_definite": enclosed.is_value,
            "worst_case_hurwitz": enclosed.stabilizing,
            "closed_loop_hurwitz": enclosed.stable,
            "delta": proof.game.delta if math.isfinite(proof.game.delta) else None,
            "delta_min_above": None if delta is None else delta.refused,
            "delta_min_at_most": None if delta is None else delta.value,
            "unstable_modes": proof.unstable,
        },
    )


def critic_proof_report(proof: CriticProof, file: str, origin: str) -> Report:
    """Distances from below and from above, and whether the gain stabilizes."""
    rows = [(name, f"{found.at_least:.6e}", f"{found.at_most:.6e}") for name, found in proof.distances.items()]
    verdict = {True: "proved Hurwitz", False: "proved not Hurwitz", None: "open: a mode may lie on the axis"}
    return Report(
        title=f"Proved: the distance of {file} from the exact solution of the game of {origin}",
        parts=[
            Table(("|X - X*| / |X*|", "at least", "at most"), rows),
            f"A - B K with this gain: {verdict[proof.stabilizes]}",
        ],
        data={
            "schema": SCHEMA,
            "statement": "critic",
            "distances": {name: found._asdict() for name, found in proof.distances.items()},
            "closed_loop_hurwitz": proof.stabilizes,
        },
    )
