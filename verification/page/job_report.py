"""What the main job says, section by section, and every number of it."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

from controller.analysis.solution_report import solution_report
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Part, Picture, Report
from hfa_support.reporting.text import Table, angle_text
from hfa_support.reporting.unit_system import system_in_force
from trim.linear.compare import comparison_table, matrices_beside_the_print
from trim.linear.entry_bands import bands_known, entry_bands
from trim.linear.linear_model import LinearModel, linear_model_report, matrices, trust_in
from trim.linear.modes import modes_of, modes_table
from trim.point.trim_report import trim_report
from verification.page.claims_section import claims_section
from verification.page.front_view import front_view
from verification.page.locus_plot import locus_plot
from verification.page.main_job import AngleResult, MainJob, TrimmedAngle
from verification.regeneration.judged_critic import critic_picture

SCHEMA = "hfa.report/1"
_COLORS = (
    "Colors of A and B: green prints the same (within 1 half unit of the last printed digit), yellow is one off "
    "(2 half units), violet at most 3 half units, red more. The table entry by entry has the half units."
)


def main_report(job: MainJob) -> Report:
    """Everything on the page below its slider; data: every number."""
    regeneration, swept = job.regeneration.report(), job.sweep.report()
    angles = [angle_report(job, angle) for angle in job.angles]
    locus, claims = locus_plot(job.sweep), claims_section(job.claims, job.regeneration)
    return Report(
        title="",
        parts=(
            Report("Root locus over the dihedral angle", (*filter(None, [locus]), swept.without_pictures())),
            *angles,
            Report("Every entry against the print", (job.regeneration.picture(),)),
            claims,
            Report("The aircraft", (job.parameters.report(),)),
        ),
        data={
            "schema": SCHEMA,
            "ok": job.ok,
            "regeneration": regeneration.data,
            "sweep": swept.data,
            "critics": [
                {"dihedral_deg": angle.trimmed.dihedral_deg, **angle.critic.report().data}
                for angle in job.angles
                if angle.critic is not None
            ],
            "angles": [report.data for report in angles],
            "claims": claims.data or None,
        },
    )


def verdicts(job: MainJob) -> Table:
    """What was checked and what came of it, a row each."""
    rows: list[tuple[Any, ...]] = [
        (f"printed pair at {pair.published.dihedral_deg:g} deg regenerated", verdict_text(pair.ok))
        for pair in job.regeneration.pairs
    ]
    for angle in job.angles:
        at = f"{angle.trimmed.dihedral_deg:g} deg"
        rows.append((f"exact game solution certified at {at}", verdict_text(angle.solution is not None)))
        rows.append((f"learned critic agrees with the exact solution at {at}", verdict_text(angle.ok)))
    trimmed = int(job.sweep.trimmed.sum())
    rows.append((f"{trimmed} of {len(job.points)} angles of the sweep trimmed", verdict_text(trimmed > 0)))
    return Table(("check", "verdict"), rows)


def angle_report(job: MainJob, angle: AngleResult) -> Report:
    """One asked angle in full: trim, drawing, linear model beside the print, game solution, learned critic."""
    trimmed, data = angle.trimmed, {"dihedral_deg": angle.trimmed.dihedral_deg, "reason": angle.reason}
    title = f"Dihedral {angle_text(trimmed.dihedral)}"
    if trimmed.model is None:
        return Report(title, (f"No trim: {angle.reason}",), data=data)
    at = f"{trimmed.dihedral_deg:g}"
    trim = trim_report(job.aircraft, trimmed.condition, trimmed.model.point)
    model = _model_report(job, angle, trimmed.model)
    drawn = front_view(job.aircraft, (trimmed,), f"trim-{at}.png")
    parts: list[Part] = [*filter(None, [drawn]), trim, model]
    data |= {"trim": trim.data, "model": model.data}
    if angle.solution is not None:
        named = trimmed.model.states, trimmed.model.inputs, f"the model at dihedral {at} deg"
        units = trimmed.model.state_units, trimmed.model.input_units
        solution = solution_report(angle.solution, *named, *units)
        parts.append(solution)
        data["solution"] = solution.data
    if (critic := angle.critic) is not None:
        text = f"P learned, P exact and their difference at {at} deg; residual and error over time"
        picture = Picture(f"critic-{at}.png", text, lambda: critic_picture(critic))
        checked = critic.report()
        parts.append(replace(checked, parts=(*checked.parts, picture)))
        data["critic"] = checked.data
    if angle.reason:
        parts.append(f"No game solution: {angle.reason}")
    return Report(title, parts, data=data)


def point_report(job: MainJob, trimmed: TrimmedAngle) -> Report:
    """What the slider shows of one angle: trim, modes, A and B."""
    title = f"At dihedral {angle_text(trimmed.dihedral)}"
    if trimmed.model is None:
        return Report(title, (f"No trim: {trimmed.reason}",))
    trim = trim_report(job.aircraft, trimmed.condition, trimmed.model.point)
    modes = modes_table(modes_of(trimmed.model.A, trimmed.model.states))
    return Report(title, (trim, Report("Modes", (modes,)), Report("A and B", matrices(trimmed.model))))


def _model_report(job: MainJob, angle: AngleResult, model: LinearModel) -> Report:
    """The linear model; where the paper prints one, with the printed entries below the computed ones."""
    known = bands_known(job.parameters)
    bands = entry_bands(job.parameters, angle.trimmed.condition, model) if known else None
    report = linear_model_report(model, bands, trust_in(bands))
    if angle.printed is None or system_in_force() == "si":  # the print is in feet
        return report
    beside = matrices_beside_the_print(model, angle.printed)
    kept = report.parts[len(beside) :]
    return replace(report, parts=(*beside, _COLORS, *kept, comparison_table(model, angle.printed)))
