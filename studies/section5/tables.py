"""The table of claims as text: for a terminal, as Markdown in full, and in short for a document."""

from __future__ import annotations

from typing import Any

from hfa_support.reporting.report import Report, markdown_table
from hfa_support.reporting.text import Cell, Table
from studies.section5.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT_FF, MODIFIED


def claims_text(table: dict[str, Any]) -> str:
    """The table for a terminal: verdicts, then each claim with its number for every law."""
    lines = [f"{claim['number']:<8}{claim['verdict']:<32}{claim['says']}" for claim in table["claims"]]
    counts = ", ".join(f"{count} {verdict}" for verdict, count in table["verdicts"].items())
    failures = [f"failed: {name}" for name in table["own_failures"]]
    return "\n".join([*lines, "", f"{counts}; {_lost_text(table)}", *failures])


def _lost_text(table: dict[str, Any]) -> str:
    lost = table["lost_flights"]
    if not lost:
        return "no flight was lost"
    laws = sorted({flight["law"] for flight in lost})
    times = [flight["lost_at"] for flight in lost]
    return f"{len(lost)} flights were lost ({'; '.join(laws)}), at {min(times):.3g} to {max(times):.3g} s"


def claims_markdown(table: dict[str, Any]) -> str:
    """The table as Markdown: one row a claim, one column a law."""
    laws = list(dict.fromkeys(law for claim in table["claims"] for law in claim["findings"]))
    rows = [
        (*_words(claim), *(_cell(claim["findings"].get(law)) for law in laws), claim["verdict"], claim["reason"])
        for claim in table["claims"]
    ]
    report = Report(
        title="Section 5 of the paper, claim by claim",
        parts=(
            "\n".join(f"- {law}: {text}" for law, text in table["laws"].items()),
            f"Matrices: {table['setting']['matrices']}. {counts_text(table)}. A number in bold fulfils the "
            f'claim. Verdicts are about "{MODIFIED}", because the law as printed overflows, or about what the claim '
            "names.",
            _in_bold(Table((*_WORDS, *laws, "verdict", "reason"), rows)),
        ),
    )
    return report.markdown() + "\n"


def claims_summary(table: dict[str, Any]) -> str:
    """`short_table` as Markdown."""
    return markdown_table(_in_bold(short_table(table)))


def short_table(table: dict[str, Any]) -> Table:
    """The number of each claim's subject, of this project's law and of the optimum; a good tone fulfils the claim."""
    beside = (CERTIFIED, CERTIFIED_FF, EXACT_FF)
    rows = []
    for claim in table["claims"]:
        own = _cell(claim["findings"][claim["subject"]])
        own = own if claim["subject"] == MODIFIED else _as_toned(f"{claim['subject']}: {{}}", own)
        rows.append((*_words(claim), own, *(_cell(claim["findings"].get(law)) for law in beside), claim["verdict"]))
    return Table((*_WORDS, MODIFIED, *beside, "verdict"), rows)


def counts_text(table: dict[str, Any]) -> str:
    """How many claims have each verdict, and which flights were lost."""
    return "; ".join([*(f"{verdict}: {count}" for verdict, count in table["verdicts"].items()), _lost_text(table)])


_WORDS = ("claim", "the paper says", "measured", "asked for")


def _words(claim: dict[str, Any]) -> tuple[str, ...]:
    return claim["number"], claim["says"], claim["measured"], f"{claim['relation']} {claim['limit']:.3g}"


def _cell(finding: dict[str, Any] | None) -> str:
    if finding is None:
        return ""
    if finding["value"] is None:
        return "lost" if finding["note"] else "∞"
    number = f"{finding['value']:.3g}"
    return Cell(number, "good") if finding["holds"] else number


def _as_toned(form: str, cell: str) -> str:
    text = form.format(cell)
    return Cell(text, cell.tone) if isinstance(cell, Cell) else text


def _in_bold(table: Table) -> Table:
    """What Markdown has for a good tone: its number in bold."""
    return Table(table.header, [tuple(map(_bold, row)) for row in table.rows])


def _bold(cell: str) -> str:
    subject, colon, number = cell.rpartition(": ")
    return f"{subject}{colon}**{number}**" if isinstance(cell, Cell) else cell
