"""The paper's claims with their verdicts, read from what the study of Section 5 (`studies/section5`) stored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import read_json
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Cell, Table
from verification.page.main_job import StoredClaims
from verification.regeneration.regeneration import Regeneration

SCHEMA = "hfa.claims/1"
_TONE = {"confirmed": "good", "not confirmed": "bad"}  # any other: it cannot be decided
#: The law that most claims are about, and those whose numbers are shown beside it.
_SUBJECT = "published, modified"
_BESIDE = ("certified", "certified + feed-forward", "exact + feed-forward")
_TITLE = "Section 5 of the paper, claim by claim"
#: Entries of the flown matrices and of the page's own that differ by less are the same.
_SAME = 1e-9


def load_claims(path: Path) -> StoredClaims:
    """claims.json, or the folder that holds it; BadInputError says what is wrong."""
    file, remedy = path / "claims.json" if path.is_dir() else path, "give what `python -m studies.section5` wrote"
    try:
        table = read_json(file)
    except OSError as error:
        raise BadInputError(f"{file}: cannot be read ({error.strerror}); {remedy}") from error
    if not isinstance(table, dict) or table.get("schema") != SCHEMA:
        raise BadInputError(f"{file}: is not a table of claims of schema {SCHEMA}; {remedy}")
    claims = StoredClaims(file, table)
    try:
        short_table(table), counts_text(table), _models(table)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"{file}: is damaged ({error!r}); {remedy}") from error
    return claims


def claims_section(claims: StoredClaims | None, regeneration: Regeneration) -> Report:
    """One row a claim; what was flown, and whether it is the aircraft of this page. Without claims, how to get them."""
    if claims is None:
        how = "Not on this page. `python -m studies.section5 -o out` computes it, `hfa report --claims out` shows it."
        return Report(_TITLE, (how,))
    table = claims.table
    short = short_table(table)
    rows = [(*row[:-1], Cell(row[-1], _TONE.get(row[-1], "near"))) for row in short.rows]
    same = "the same matrices as" if flies_the_same(table, regeneration) else "OTHER matrices than"
    said = (
        f"Read from {claims.path}, which `python -m studies.section5` wrote. {counts_text(table)}.",
        f"It flew {table['setting']['matrices']} matrices, {same} those of this page. A green number fulfils a claim.",
    )
    return Report(_TITLE, (*said, Table(short.header, rows)), data=table)


def short_table(table: dict[str, Any]) -> Table:
    """The number of each claim's subject, of the certified law and of the optimum; a good tone fulfils the claim."""
    rows = []
    for claim in table["claims"]:
        found, subject = claim["findings"], claim["subject"]
        own = _cell(found[subject], "" if subject == _SUBJECT else f"{subject}: ")
        asked = f"{claim['relation']} {claim['limit']:.3g}"
        beside = (_cell(found[law]) if law in found else "" for law in _BESIDE)
        rows.append((claim["number"], claim["says"], claim["measured"], asked, own, *beside, claim["verdict"]))
    return Table(("claim", "the paper says", "measured", "asked for", _SUBJECT, *_BESIDE, "verdict"), rows)


def _cell(finding: dict[str, Any], before: str = "") -> str:
    if finding["value"] is None:
        return before + ("lost" if finding["note"] else "∞")
    text = f"{before}{finding['value']:.3g}"
    return Cell(text, "good") if finding["holds"] else text


def counts_text(table: dict[str, Any]) -> str:
    """How many claims have each verdict, and which flights were lost."""
    counts = "; ".join(f"{verdict}: {count}" for verdict, count in table["verdicts"].items())
    lost = table["lost_flights"]
    if not lost:
        return f"{counts}; no flight was lost"
    laws, times = sorted({flight["law"] for flight in lost}), [flight["lost_at"] for flight in lost]
    return f"{counts}; {len(lost)} flights were lost ({'; '.join(laws)}), at {min(times):.3g} to {max(times):.3g} s"


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
