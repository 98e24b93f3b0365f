"""PDF documents: every row of a report is on its pages, which are numbered and not almost empty."""

from dataclasses import replace

import pypdf
import pytest

from hfa_support.reporting.report import Report
from hfa_support.reporting.rows import Group, Row
from hfa_support.reporting.text import Cell, Table

#: A sentence longer than a line of a cell.
WORDS = "that no table of the aircraft states the limit of this control surface at this speed"


def sheet(count, title="UAV trimmed: level, 35 m/s"):
    """Return a sheet, the report of one trim: four groups of `count` rows, each with a note of
    growing length, and a sentence below each group.
    """
    groups = []
    for name in ("condition", "trim", "performance", "modes and levels"):
        rows = [Row(f"{name} {i}", 0.5 + i, "rad/s", WORDS[: 3 * i]) for i in range(count)]
        groups.append(Group(name, tuple(rows), (f"{name}: {WORDS}",)))
    head = {"aircraft": "UAV", "data": "uav.toml (SHA-256 7a161f847917)", "condition": "level"}
    return Report(title, groups, ["a note"], source="hfa 0.4.0", head=head)


def pages(report, path):
    """Return the texts of the pages of a report, without blanks and line breaks."""
    report.save(path / "report.pdf")
    read = pypdf.PdfReader(path / "report.pdf").pages
    return ["".join(page.extract_text().split()) for page in read]


def lost(report, text):
    """Return the cells and sentences of a report that are not in a text without blanks."""
    expected = [*report.title.split("\n"), *report.notes, *report.head.values()]
    for part in report.parts:
        if isinstance(part, Report):
            expected += lost(part, text)
        elif isinstance(part, Group):
            expected += [part.title, *part.lines]
            expected += [cell for row in part.rows for cell in row.cells()]
        elif isinstance(part, Table):
            expected += [*part.header, *(str(cell) for row in part.rows for cell in row)]
    return [each for each in expected if "".join(each.split()) not in text]


@pytest.mark.parametrize(("count", "expected"), [(16, 1), (24, 2)])
def test_a_sheet_has_all_rows_and_as_few_pages_as_they_need(count, expected, tmp_path):
    """All rows of a sheet are on the expected number of pages, which are numbered "1 of 2" and not
    almost empty.

    count: rows in each of the four groups of the sheet
    """
    report = sheet(count)
    texts = pages(report, tmp_path)
    assert len(texts) == expected
    assert not lost(report, "".join(texts))
    for number, text in enumerate(texts, start=1):
        assert f"{number}of{len(texts)}" in text
        assert len(text) > 400  # a full page has more than 1000 characters


def test_a_document_has_outline_links_and_dates(tmp_path):
    """Each report is an entry of the outline at its level, the name of a condition is a link to its
    page, and the properties have title, document and date of issue; the footer of each page has
    document and aircraft.
    """
    inner = replace(sheet(1, "one: level"), anchor="c1")
    table = Table(("condition", "x"), [(Cell("one", link="c1"), "1")])
    head = {"document": "12, B", "aircraft": "UAV", "issued": "2026-05-04"}
    made = Report("Book\nCheck: a warning", [(table,), inner], ["a note"], head=head)
    made.save(tmp_path / "a.pdf")
    read = pypdf.PdfReader(tmp_path / "a.pdf")
    assert (read.metadata.title, read.metadata.subject) == ("Book", "12, B")
    assert str(read.metadata.creation_date).startswith("2026-05-04")
    outline = read.outline
    assert [outline[0].title, *(each.title for each in outline[1])] == ["Book", "one: level"]
    assert read.get_destination_page_number(outline[1][0]) == len(read.pages) - 1
    for page in read.pages[:2]:  # the contents, and the cell of the table
        targets = [each.get_object()["/Dest"][0].get_object() for each in page["/Annots"]]
        assert {*map(read.get_page_number, targets)} == {2}
    for page in read.pages:
        assert "12, B, UAV" in page.extract_text()
    first, of_table, last = (page.extract_text() for page in read.pages)
    for said in ("author", "checked", "approved", "a note", "Check: a warning"):
        assert said in first
    assert "approved" not in of_table + last
    assert read.pages[1].mediabox.width > read.pages[1].mediabox.height
    sheet(1).save(tmp_path / "b.pdf")
    (page,) = pypdf.PdfReader(tmp_path / "b.pdf").pages
    assert "signature" in page.extract_text()
