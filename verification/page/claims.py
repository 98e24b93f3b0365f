"""The claims of Section 5 of the paper, as `python -m studies.section5` checked and stored them."""

from __future__ import annotations

from pathlib import Path
from typing import Any, NamedTuple

import numpy as np

from hfa_support.errors import BadInputError
from hfa_support.files import read_json
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Cell, Table
from hfa_support.schema import NUMBER, checked
from verification.regeneration.regeneration import Regeneration

_FINDING = {"value*": None, "holds*": None, "note*": str, ...: None}
_CLAIM = dict.fromkeys(("number*", "says*", "measured*", "relation*", "subject*", "verdict*"), str)
_MODEL = {"dihedral_deg*": NUMBER, "A*": [[NUMBER]], "B*": [[NUMBER]]}
_DECLARED: dict[Any, Any] = {
    "schema*": ("hfa.claims/1",),
    "claims*": [{**_CLAIM, "limit*": NUMBER, "findings*": {str: _FINDING}, ...: None}],
    "verdicts*": {...: None},
    "lost_flights*": [{...: None}],
    "setting*": {"matrices*": str, "models*": [_MODEL], ...: None},
    ...: None,
}
_TONE = {"confirmed": "good", "not confirmed": "bad"}  # any other: it cannot be decided
#: The law that most claims are about, and those whose numbers are shown beside it.
_SUBJECT = "published, modified"
_BESIDE = ("certified", "certified + feed-forward", "exact + feed-forward")
_TITLE = "Claims of Section 5 of the paper"
#: Entries of the flown matrices and of the page's own that differ by less are the same.
_SAME = 1e-9


class Claims(NamedTuple):
    """The stored table, and the file it was read from."""

    path: Path
    table: dict[str, Any]

    @property
    def verdicts(self) -> str:
        """How many claims have each verdict."""
        return ", ".join(f"{count} {verdict}" for verdict, count in self.table["verdicts"].items())

    def fly(self, regeneration: Regeneration) -> bool:
        """Whether the stored flights were those of the linear models regenerated here."""
        own = {pair.published.dihedral_deg: pair.model for pair in regeneration.pairs}
        models = self.table["setting"]["models"]
        return bool(models) and all(
            each["dihedral_deg"] in own
            and np.shape(each[name]) == mine.shape
            and np.allclose(each[name], mine, rtol=_SAME, atol=_SAME)
            for each in models
            for name in ("A", "B")
            for mine in [getattr(own.get(each["dihedral_deg"]), name, np.zeros(0))]
        )

    def report(self, regeneration: Regeneration) -> Report:
        """One row a claim, a green number meeting its criterion; what was flown, and whether it is this aircraft."""
        rows = []
        for claim in self.table["claims"]:
            found, subject = claim["findings"], claim["subject"]
            own = _cell(found[subject], "" if subject == _SUBJECT else f"{subject}: ")
            beside = (_cell(found[law]) if law in found else "" for law in _BESIDE)
            about = claim["number"], claim["says"], claim["measured"], f"{claim['relation']} {claim['limit']:.3g}"
            rows.append((*about, own, *beside, Cell(claim["verdict"], _TONE.get(claim["verdict"], "near"))))
        same = "the same matrices as" if self.fly(regeneration) else "OTHER matrices than"
        said = (
            f"Read from {self.path}, which `python -m studies.section5` wrote. {self.verdicts}; "
            f"flights lost: {len(self.table['lost_flights'])}. It flew {self.table['setting']['matrices']} matrices, "
            f"{same} those of this page. A green number meets the criterion of its claim."
        )
        header = ("claim", "the paper says", "measured", "asked for", _SUBJECT, *_BESIDE, "verdict")
        return Report(_TITLE, (said, Table(header, rows)), data=self.table)


def claims_section(claims: Claims | None, regeneration: Regeneration) -> Report:
    """The report of the claims; without claims, how to get them."""
    if claims is None:
        how = "Not on this page. `python -m studies.section5 -o out` computes it, `hfa report --claims out` shows it."
        return Report(_TITLE, (how,))
    return claims.report(regeneration)


def load_claims(path: Path) -> Claims:
    """claims.json, or the folder that holds it; BadInputError names the fault."""
    file = path / "claims.json" if path.is_dir() else path
    try:
        return Claims(file, checked(str(file), read_json(file), _DECLARED))
    except OSError as error:
        remedy = "give what `python -m studies.section5` wrote"
        raise BadInputError(f"{file}: cannot be read ({error.strerror}); {remedy}") from error


def _cell(finding: dict[str, Any], before: str = "") -> str:
    if finding["value"] is None:
        return before + ("lost" if finding["note"] else "∞")
    text = f"{before}{finding['value']:.3g}"
    return Cell(text, "good") if finding["holds"] else text
