"""Claims of Section 5 of the paper, as stored in studies/section5/results."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any, NamedTuple

from hfa_page.stored import Models, are_same_models, models_in, read_study
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Cell, Table
from verification.regeneration import Regeneration

SCHEMA = "hfa.claims/1"
_STORED = "studies/section5/results"
#: The law that most claims concern, and the laws whose numbers are shown for comparison.
_MAIN_LAW = "published, modified"
_OTHER_LAWS = ("certified", "certified + feed-forward", "exact + feed-forward")
_TITLE = "Claims of Section 5 of the paper"


class Claims(NamedTuple):
    """Content of claims.json.

    data: the complete content
    about: sentence on the file and its provenance
    rows: table with one row for each claim
    models: (dihedral angle in deg, A, B) of each linear model in the simulated flights
    """

    data: dict[str, Any]
    about: str
    rows: Table
    models: Models

    @property
    def counts(self) -> str:
        """Text such as "24 confirmed, 28 not confirmed, 3 not decidable"."""
        return ", ".join(f"{count} {verdict}" for verdict, count in self.data["verdicts"].items())

    def matches(self, regeneration: Regeneration) -> bool:
        """Return whether the stored flights used the same A and B as a regeneration."""
        pairs = regeneration.pairs
        return are_same_models(
            self.models,
            {pair.published.dihedral_deg: (pair.model.A, pair.model.B) for pair in pairs},
        )


def claims_section(claims: Claims | None, regeneration: Regeneration) -> Report:
    """Return the section of the page on the paper's claims.

    A sentence states whether the claims were checked with the A and B of this page. Without claims,
    the section states how to show them.
    """
    if claims is None:
        how = f"Not on this page. `hfa report --claims {_STORED}` shows the stored results."
        return Report(_TITLE, (how,))
    same = "the same matrices as" if claims.matches(regeneration) else "OTHER matrices than"
    return Report(
        _TITLE, (f"{claims.about}, {same} those of this page.", claims.rows), data=claims.data
    )


def load_claims(path: str) -> Claims:
    """Return the content of claims.json.

    path: the file, or the folder that contains it

    Raises BadInputError if the file cannot be read, has another schema or lacks an entry.
    """
    return read_study(path, "claims.json", SCHEMA, _STORED, _claims)


def _claims(file: Path, data: dict[str, Any]) -> Claims:
    """Return the claims in the data of a file."""
    setting = data["setting"]
    lost = len(data["lost_flights"])
    about = (
        f"Read from {file}, stored results. A green number meets the criterion of its"
        f" claim. Flights that left the envelope: {lost}; {setting['matrices']} "
        "matrices"
    )
    return Claims(data, about, claims_table(data["claims"]), models_in(setting["models"]))


def claims_table(claims: Sequence[dict[str, Any]]) -> Table:
    """Return a table with one row for each claim: verdict, text, criterion and measured numbers."""
    rows = []
    for claim in claims:
        findings = claim["findings"]
        law = claim["subject"]
        of_law = _cell(findings[law], "" if law == _MAIN_LAW else f"{law}: ")
        of_others = [_cell(findings[name]) if name in findings else "" for name in _OTHER_LAWS]
        rows.append(
            (
                claim["number"],
                claim["verdict"],
                claim["says"],
                claim["measured"],
                f"{claim['relation']} {claim['limit']:.3g}",
                of_law,
                *of_others,
            )
        )
    return Table(
        ("claim", "verdict", "the paper says", "measured", "required", _MAIN_LAW, *_OTHER_LAWS),
        rows,
    )


def _cell(finding: dict[str, Any], before: str = "") -> str:
    """Return the cell of a measured number, green if it meets the criterion.

    before: text before the number
    """
    if finding["value"] is None:
        return before + ("lost" if finding["note"] else "∞")
    return Cell(f"{before}{finding['value']:.3g}", "good" if finding["holds"] else "")
