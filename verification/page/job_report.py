"""What the main job says, section by section, and every number of it."""

from __future__ import annotations

from dataclasses import replace
from typing import TYPE_CHECKING, Any

from controller.analysis.solution_report import solution_report
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Part, Picture, Report
from hfa_support.reporting.text import Cell, Table, angle_text
from hfa_support.reporting.unit_system import system_in_force
from trim.linear.compare import comparison_table, matrices_beside_the_print
from trim.linear.entry_bands import bands_known, entry_bands, trust_in
from trim.linear.linear_model import LinearModel, linear_model_report, matrices
from trim.linear.modes import modes_of, modes_table
from trim.point.trim_report import trim_report
from verification.critic.check_result import check_figure
from verification.page.claims import claims_section
from verification.page.main_job import Angle, MainJob
from verification.page.plots import front_view, locus_plot

if TYPE_CHECKING:
    from matplotlib.figure import Figure

SCHEMA = "hfa.report/1"
_COLORS = (
    "Colors of A and B: green prints the same (within 1 half unit of the last printed digit), yellow is one off "
    "(2 half units), violet at most 3 half units, red more. The table entry by entry has the half units."
)


def main_report(job: MainJob) -> Report:
    """What the page shows below its slider; data: every number."""
    regeneration, swept = job.regeneration.report(), job.sweep.report()
    angles = [angle_report(job, angle) for angle in job.angles]
    claims = claims_section(job.claims, job.regeneration)
    pictures = front_view(job.aircraft, job.points), locus_plot(job.sweep)
    critics = [
        {"dihedral_deg": each.data["dihedral_deg"], **each.data["critic"]} for each in angles if "critic" in each.data
    ]
    return Report(
        title="",
        parts=(
            Report("Any dihedral angle", [each for each in pictures if each is not None]),
            *angles,
            claims,
            Report("Every entry against the print", (job.regeneration.picture(),)),
            Report("Modes over the dihedral angle", (swept.without_pictures(),)),
            Report("The aircraft", (job.parameters.report(),)),
        ),
        data={
            "schema": SCHEMA,
            "ok": job.ok,
            "regeneration": regeneration.data,
            "sweep": swept.data,
            "critics": critics,
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
        at = f"{angle.dihedral_deg:g} deg"
        rows.append((f"exact game solution certified at {at}", verdict_text(angle.solution is not None)))
        rows.append((f"learned critic agrees with the exact solution at {at}", verdict_text(angle.ok)))
    trimmed = int(job.sweep.trimmed.sum())
    rows.append((f"{trimmed} of {len(job.points)} angles of the sweep trimmed", verdict_text(trimmed > 0)))
    if job.claims is not None:
        rows.append((f"claims of Section 5 of the paper: {job.claims.verdicts}", Cell("findings", "near")))
    return Table(("check", "verdict"), rows)


def angle_report(job: MainJob, angle: Angle) -> Report:
    """One asked angle: linear model with the print, game solution, learned critic; the slider shows its trim."""
    model, data = angle.model, {"dihedral_deg": angle.dihedral_deg, "reason": angle.reason}
    title = f"Dihedral {angle_text(angle.dihedral)}: model, game, critic"
    if model is None:
        return Report(title, (f"No trim: {angle.reason}",), data=data)
    origin = f"the model at dihedral {angle_text(angle.dihedral)}, {model.point.dynamics} dynamics"
    named = model.states, model.inputs, origin, model.state_units, model.input_units
    shown = {"model": _model_report(job, angle, model)}
    if angle.solution is not None:
        shown["solution"] = solution_report(angle.solution, *named)
    if (check := angle.check) is not None:

        def draw() -> Figure:
            return check_figure(check, *named)

        text = f"P learned, P exact and their difference at {angle.dihedral_deg:g} deg; residual and error over time"
        judged, picture = check.report(*named), Picture(f"critic-{angle.dihedral_deg:g}.png", text, draw)
        shown["critic"] = replace(judged, parts=(*judged.parts, picture))
    unsolved = [f"No game solution: {angle.reason}"] if angle.reason else []
    trim = trim_report(job.aircraft, angle.condition, model.point)
    data |= {"trim": trim.data} | {name: each.data for name, each in shown.items()}
    return Report(title, (*shown.values(), *unsolved), data=data)


def point_report(job: MainJob, angle: Angle) -> Report:
    """What the slider shows of one angle: trim, modes, A and B."""
    title = f"At dihedral {angle_text(angle.dihedral)}"
    if angle.model is None:
        return Report(title, (f"No trim: {angle.reason}",))
    trim = trim_report(job.aircraft, angle.condition, angle.model.point)
    modes = modes_table(modes_of(angle.model.A, angle.model.states))
    return Report(title, (trim, Report("Modes", (modes,)), Report("A and B", matrices(angle.model))))


def _model_report(job: MainJob, angle: Angle, model: LinearModel) -> Report:
    """The linear model; where the paper prints one, with the printed entries below the computed ones."""
    bands = entry_bands(job.parameters, angle.condition, model) if bands_known(job.parameters) else None
    report = linear_model_report(model, bands, trust_in(bands))
    if angle.printed is None or system_in_force() == "si":  # the print is in feet
        return report
    beside: tuple[Part, ...] = matrices_beside_the_print(model, angle.printed)
    kept = report.parts[len(beside) :]
    return replace(report, parts=(*beside, _COLORS, *kept, comparison_table(model, angle.printed)))
