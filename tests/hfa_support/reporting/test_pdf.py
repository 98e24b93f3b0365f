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


@pytest.mark.parametrize(
    ("count", "expected"), [(3, 1), pytest.param(16, 1, marks=pytest.mark.slow), (24, 2)]
)
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


def test_a_row_that_is_not_on_the_page_is_found(tmp_path):
    """`lost`, which the other tests use, finds the cells of a row that the page does not have."""
    report = sheet(3)
    (text,) = pages(report, tmp_path)
    first = report.parts[0]
    planted = first._replace(rows=(*first.rows, Row("planted", 17.25)))
    assert lost(replace(report, parts=[planted]), text) == ["planted", "17.25"]


def test_a_long_name_and_long_cells_are_wrapped(tmp_path):
    """A title of 240 characters and a cell of 200 are whole on the page. Markup in the title is
    text, and the control character is shown as \\x1b.
    """
    title = f"{'Very long name of an aircraft ' * 8}\nCheck: a < b & <c>\x1b[31m"
    report = replace(sheet(3, title), head={"aircraft": title[:200]})
    (text,) = pages(report, tmp_path)
    escaped = replace(report, title=title.replace("\x1b", "\\x1b"))
    assert not lost(escaped, text)


def book(count):
    """Return a book, the report of several trims: a table of `count` conditions (the matrix), and
    the sheets of the first two.
    """
    rows = [(f"condition {i}", Cell("stalled", "bad"), f"{i}.5", WORDS) for i in range(count)]
    matrix = Table(("condition", "results", "alpha [deg]", "warnings"), rows)
    sheets = [sheet(3, f"condition {i}: level") for i in range(min(count, 2))]
    return Report("60 conditions", [(matrix, f"3: {WORDS}"), *sheets], head={"document": "12, B"})


@pytest.mark.parametrize("count", [1, 51, pytest.param(60, marks=pytest.mark.slow)])
def test_a_book_has_a_cover_a_matrix_and_a_page_for_each_sheet(count, tmp_path):
    """A book has a cover with lines to sign and the page numbers of the sheets; then pages of the
    matrix, each with one header and at least three rows; at the end a page for each sheet, with the
    document's number.
    """
    texts = pages(book(count), tmp_path)
    assert not lost(book(count), "".join(texts))
    sheets = min(count, 2)
    cover, of_matrix, of_sheets = texts[0], texts[1:-sheets], texts[-sheets:]
    assert "signature" in cover
    for index, text in enumerate(of_sheets):
        page = 1 + len(of_matrix) + index + 1
        assert f".{page}condition{index}" in cover
        assert f"condition{index}:level" in text
        assert "12,B" in text
    for text in of_matrix:
        assert text.count("stalled") >= min(count, 3)  # once in each row
        assert text.count("results") == 1  # in the header


def test_a_table_wider_than_the_page_continues_in_blocks(tmp_path):
    """A table of 30 columns has all cells on a page, in three blocks that begin with the first
    column.
    """
    header = tuple(f"column{i}" for i in range(30))
    table = Table(header, [tuple(f"{row}.{i}25" for i in range(30)) for row in range(3)])
    wide = Report("wide", [table])
    (text,) = pages(wide, tmp_path)
    assert not lost(wide, text)
    assert text.count("column0") == 3  # blocks
