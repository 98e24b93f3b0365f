"""What the regeneration of the printed pairs says."""

from __future__ import annotations

from hfa_model.reporting.checks import checks_block
from hfa_model.reporting.report import Picture, Report
from hfa_model.reporting.text import Table, eigenvalue_text
from trim.linear.compare import comparison_table, entries_records
from trim.linear.linear_model import matrices
from verification.published.regeneration import RegeneratedPair, Regeneration
from verification.published.regeneration_figure import regeneration_figure

SCHEMA = "hfa.regeneration/1"


def regeneration_report(found: Regeneration) -> Report:
    """Both pairs beside the print, entry by entry, the spectra and the verdict."""
    reports = [pair_report(pair) for pair in found.pairs]
    return Report(
        title="",
        parts=(*reports, difference_picture(found), f"Both pairs regenerated: {'yes' if found.ok else 'NO'}"),
        data={"schema": SCHEMA, "ok": found.ok, "cases": [dict(report.data) for report in reports]},
        records=entries_records({pair.published.dihedral_deg: pair.entries for pair in found.pairs}),
    )


def difference_picture(found: Regeneration) -> Picture:
    """Every entry's difference from its print."""
    text = "Difference of every entry from its print"
    return Picture("regeneration.png", text, lambda: regeneration_figure(found.pairs))


def pair_report(pair: RegeneratedPair) -> Report:
    """One printed angle: A and B, entry by entry, the spectra and the checks."""
    model, printed_deg = pair.model, pair.published.dihedral_deg
    spectra = [
        ("", eigenvalue_text(printed), eigenvalue_text(computed))
        for printed, computed in zip(pair.printed_eigenvalues, pair.eigenvalues, strict=True)
        if printed.imag >= 0
    ]
    return Report(
        title=f"Dihedral {printed_deg:g} deg, {model.point.dynamics} dynamics",
        parts=(
            *matrices(model),
            comparison_table(model, pair.published),
            Table(("eigenvalues 1/s", "printed A", "regenerated A"), spectra),
            checks_block(pair.checks),
        ),
        data={
            "dihedral_deg": printed_deg,
            "dynamics": model.point.dynamics,
            "operating_point": model.point.to_dict(),
            "states": list(model.states),
            "inputs": list(model.inputs),
            "A": model.A.tolist(),
            "B": model.B.tolist(),
            "entries": [entry.to_dict() for entry in pair.entries],
            "printed_eigenvalues": [[value.real, value.imag] for value in pair.printed_eigenvalues.tolist()],
            "eigenvalues": [[value.real, value.imag] for value in pair.eigenvalues.tolist()],
            "checks": [check.to_dict() for check in pair.checks],
        },
        records=entries_records({printed_deg: pair.entries}),
    )
