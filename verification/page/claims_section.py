"""The paper's claims with their verdicts, read back from what `hfa reproduce` stored."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import read_json
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, Toned
from verification.experiments.claims import CONFIRMED, NOT_CONFIRMED, NOT_DECIDABLE
from verification.experiments.reproduction import SCHEMA
from verification.experiments.tables import counts_text, short_table
from verification.page.main_job import StoredClaims
from verification.regeneration.regeneration import Regeneration

_TONE = {CONFIRMED: "good", NOT_CONFIRMED: "bad", NOT_DECIDABLE: "near"}
_TITLE = "Section 5 of the paper, claim by claim"
#: Entries of the flown matrices and of the page's own that differ by less are the same.
_SAME = 1e-9


def load_claims(path: Path) -> StoredClaims:
    """claims.json, or the folder of `hfa reproduce` that holds it; BadInputError says what is wrong."""
    file = path / "claims.json" if path.is_dir() else path
    try:
        table = read_json(file)
    except OSError as error:
        raise BadInputError(f"{file}: cannot be read ({error.strerror}); give what `hfa reproduce` wrote") from error
    if not isinstance(table, dict) or table.get("schema") != SCHEMA:
        raise BadInputError(f"{file}: is not a table of claims of schema {SCHEMA}; give what `hfa reproduce` wrote")
    claims = StoredClaims(file, table)
    try:
        short_table(table), counts_text(table), _models(table)
    except (KeyError, TypeError, ValueError, AttributeError) as error:
        raise BadInputError(f"{file}: is damaged ({error!r}); run `hfa reproduce` again") from error
    return claims


def claims_section(claims: StoredClaims | None, regeneration: Regeneration) -> Report:
    """One row a claim; what was flown, and whether it is the aircraft of this page. Without claims, how to get them."""
    if claims is None:
        how = "Not on this page. `hfa reproduce all -o out` computes it, `hfa report --claims out` shows it."
        return Report(_TITLE, (how,))
    table = claims.table
    short = short_table(table)
    rows = [(*row[:-1], Toned(row[-1], _TONE.get(row[-1], "near"))) for row in short.rows]
    same = "the same matrices as" if flies_the_same(table, regeneration) else "OTHER matrices than"
    said = (
        f"Not computed here but read from {claims.path}, which `hfa reproduce` wrote. {counts_text(table)}.",
        f"It flew {table['setting']['matrices']} matrices, {same} those of this page. A green number fulfils a claim.",
    )
    return Report(_TITLE, (*said, Table(short.header, rows)), data=table)


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
