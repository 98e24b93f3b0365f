"""What the main job says, section by section, and every number of it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.analysis.solution_report import solution_report
from hfa_support.errors import BadInputError
from hfa_support.files import read_json
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
from verification.page.main_job import Angle, MainJob, StoredClaims
from verification.page.plots import front_view, locus_plot
from verification.regeneration.regeneration import Regeneration

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
            "critics": [
                {"dihedral_deg": angle.dihedral_deg, **angle.critic.report().data}
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
        at = f"{angle.dihedral_deg:g} deg"
        rows.append((f"exact game solution certified at {at}", verdict_text(angle.solution is not None)))
        rows.append((f"learned critic agrees with the exact solution at {at}", verdict_text(angle.ok)))
    trimmed = int(job.sweep.trimmed.sum())
    rows.append((f"{trimmed} of {len(job.points)} angles of the sweep trimmed", verdict_text(trimmed > 0)))
    if job.claims is not None:
        rows.append((f"claims of Section 5 of the paper: {_verdicts(job.claims.table)}", Cell("findings", "near")))
    return Table(("check", "verdict"), rows)


def angle_report(job: MainJob, angle: Angle) -> Report:
    """One asked angle: linear model with the print, game solution, learned critic; the slider shows its trim."""
    model, data = angle.model, {"dihedral_deg": angle.dihedral_deg, "reason": angle.reason}
    title = f"Dihedral {angle_text(angle.dihedral)}: model, game, critic"
    if model is None:
        return Report(title, (f"No trim: {angle.reason}",), data=data)
    at = f"{angle.dihedral_deg:g}"
    shown = {"model": _model_report(job, angle, model)}
    if angle.solution is not None:
        named = model.states, model.inputs, f"the model at dihedral {at} deg", model.state_units, model.input_units
        shown["solution"] = solution_report(angle.solution, *named)
    if (critic := angle.critic) is not None:
        text = f"P learned, P exact and their difference at {at} deg; residual and error over time"
        time, checked = critic.run.settings["predefined_time"], critic.report()

        def draw() -> Figure:
            return check_figure(critic.check, *critic.names, run=critic.run, predefined_time=time)

        shown["critic"] = replace(checked, parts=(*checked.parts, Picture(f"critic-{at}.png", text, draw)))
    unsolved = f"No game solution: {angle.reason}" if angle.reason else None
    parts: list[Part] = [part for part in (*shown.values(), unsolved) if part is not None]
    trim = trim_report(job.aircraft, angle.condition, model.point)
    return Report(title, parts, data=data | {"trim": trim.data} | {name: each.data for name, each in shown.items()})


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
    known = bands_known(job.parameters)
    bands = entry_bands(job.parameters, angle.condition, model) if known else None
    report = linear_model_report(model, bands, trust_in(bands))
    if angle.printed is None or system_in_force() == "si":  # the print is in feet
        return report
    beside = matrices_beside_the_print(model, angle.printed)
    kept = report.parts[len(beside) :]
    return replace(report, parts=(*beside, _COLORS, *kept, comparison_table(model, angle.printed)))


_CLAIMS = "hfa.claims/1"
_TONE = {"confirmed": "good", "not confirmed": "bad"}  # any other: it cannot be decided
#: The law that most claims are about, and those whose numbers are shown beside it.
_SUBJECT = "published, modified"
_BESIDE = ("certified", "certified + feed-forward", "exact + feed-forward")
_TITLE = "Claims of Section 5 of the paper"
#: Entries of the flown matrices and of the page's own that differ by less are the same.
_SAME = 1e-9


def load_claims(path: Path) -> StoredClaims:
    """claims.json, or the folder that holds it; BadInputError names the fault."""
    file, remedy = path / "claims.json" if path.is_dir() else path, "give what `python -m studies.section5` wrote"
    try:
        table = read_json(file)
    except OSError as error:
        raise BadInputError(f"{file}: cannot be read ({error.strerror}); {remedy}") from error
    if not isinstance(table, dict) or table.get("schema") != _CLAIMS:
        raise BadInputError(f"{file}: is not a table of claims of schema {_CLAIMS}; {remedy}")
    claims = StoredClaims(file, table)
    try:
        _claims_table(table), _counts(table), _models(table)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"{file}: is damaged ({error!r}); {remedy}") from error
    return claims


def claims_section(claims: StoredClaims | None, regeneration: Regeneration) -> Report:
    """One row a claim; what was flown, and whether it is the aircraft of this page. Without claims, how to get them."""
    if claims is None:
        how = "Not on this page. `python -m studies.section5 -o out` computes it, `hfa report --claims out` shows it."
        return Report(_TITLE, (how,))
    table = claims.table
    same = "the same matrices as" if flies_the_same(table, regeneration) else "OTHER matrices than"
    said = (
        f"Read from {claims.path}, which `python -m studies.section5` wrote. {_counts(table)}.",
        f"It flew {table['setting']['matrices']} matrices, {same} those of this page.",
        "A green number meets the criterion of its claim.",
    )
    return Report(_TITLE, (*said, _claims_table(table)), data=table)


def _claims_table(table: dict[str, Any]) -> Table:
    """The number of each claim's subject, of the certified law and of the optimum; a good tone fulfils the claim."""
    rows = []
    for claim in table["claims"]:
        found, subject, verdict = claim["findings"], claim["subject"], claim["verdict"]
        own = _cell(found[subject], "" if subject == _SUBJECT else f"{subject}: ")
        asked = f"{claim['relation']} {claim['limit']:.3g}"
        beside = (_cell(found[law]) if law in found else "" for law in _BESIDE)
        about = claim["number"], claim["says"], claim["measured"], asked, own
        rows.append((*about, *beside, Cell(verdict, _TONE.get(verdict, "near"))))
    return Table(("claim", "the paper says", "measured", "asked for", _SUBJECT, *_BESIDE, "verdict"), rows)


def _cell(finding: dict[str, Any], before: str = "") -> str:
    if finding["value"] is None:
        return before + ("lost" if finding["note"] else "∞")
    text = f"{before}{finding['value']:.3g}"
    return Cell(text, "good") if finding["holds"] else text


def _counts(table: dict[str, Any]) -> str:
    """How many claims have each verdict, and which flights were lost."""
    counts = _verdicts(table)
    lost = table["lost_flights"]
    if not lost:
        return f"{counts}; no flight was lost"
    laws, times = sorted({flight["law"] for flight in lost}), [flight["lost_at"] for flight in lost]
    return f"{counts}; {len(lost)} flights were lost ({'; '.join(laws)}), at {min(times):.3g} to {max(times):.3g} s"


def _verdicts(table: dict[str, Any]) -> str:
    return ", ".join(f"{count} {verdict}" for verdict, count in table["verdicts"].items())


def flies_the_same(table: dict[str, Any], regeneration: Regeneration) -> bool:
    """Whether the stored flights were those of the linear models regenerated here."""
    own = {pair.published.dihedral_deg: pair.model for pair in regeneration.pairs}
    models = _models(table)
    return bool(models) and all(
        angle in own
        and A.shape == own[angle].A.shape
        and B.shape == own[angle].B.shape
        and np.allclose(A, own[angle].A, rtol=_SAME, atol=_SAME)
        and np.allclose(B, own[angle].B, rtol=_SAME, atol=_SAME)
        for angle, A, B in models
    )


def _models(table: dict[str, Any]) -> list[tuple[float, np.ndarray, np.ndarray]]:
    return [
        (float(each["dihedral_deg"]), np.array(each["A"], dtype=float), np.array(each["B"], dtype=float))
        for each in table["setting"]["models"]
    ]
