"""Reports as text, Markdown, HTML and data files, with every text escaped."""

import csv
import json
from dataclasses import replace

import numpy as np
import pandas as pd
import pytest

from hfa import BadInputError
from hfa.extend import Report, Table
from hfa_support.matrices import labels_of
from hfa_support.reporting.text import eigenvalue_text


def report():
    """Return a report with a paragraph, a nested report with a table, and a note, with characters
    that Markdown or HTML must escape.
    """
    table = Table(("load", "value"), [("lift <1>", "2.5"), ("a|b", "10")])
    inner = Report("Inner", ((table, "below the table"),))
    return Report(
        title="Title & more\nof it",
        parts=("first", inner),
        notes=("take care",),
    )


def test_markdown_has_headings_and_tables():
    """A report becomes Markdown with headings by level, tables with escaped columns, and notes."""
    assert (
        report().markdown()
        == "# Title & more\n\nof it\n\nfirst\n\n## Inner\n\n| load | value |\n|---|---|\n| lift <1>"
        " | 2.5 |\n| a\\|b | 10 |\n\nbelow the table\n\nNote: take care"
    )


def test_html_has_real_tables_and_escapes_every_word():
    """The HTML of a report has headings from the given level on, tables with row headers in a box,
    and every text is escaped.
    """
    made = report()
    html = made.html(2)
    assert html.startswith(
        "<h2>Title &amp; more</h2>\n<p>of it</p>\n<p>first</p>\n<h3>Inner</h3>\n"
    )
    assert '<div class="table" role="group" tabindex="0" aria-label="table: load"><table>' in html
    assert '<tr><th scope="row">lift &lt;1&gt;</th><td>2.5</td></tr>' in html
    assert html.endswith("<p>Note: take care</p>")
    assert made.html().startswith(
        "<h1>Title &amp; more</h1>\n<p>of it</p>\n<p>first</p>\n<h2>Inner</h2>\n"
    )


@pytest.mark.parametrize("name", ["\x1b[31mred", "a\rb", "a\nb", "\u202egpj", "\ud800"])
def test_control_characters_in_names_are_escaped(name):
    """Control characters in a name are escaped in text, Markdown and HTML."""
    made = Report(name, (name, Table((name, "value"), [(name, "1")])), notes=(name,))
    for text in (made.text(), made.markdown(), made.html()):
        lines = text.replace("\n", "")
        assert lines.isprintable()
        assert lines.encode()
    rows = [line for line in made.text().splitlines() if "value" in line or line.endswith(" 1")]
    assert len(rows) == 2  # header and row of the table, each on one line


def test_names_become_no_formulas_links_or_columns(tmp_path):
    """A name that a spreadsheet would compute as a formula begins with ' in a .csv file, and other
    names are unchanged. In Markdown, no name becomes a link, a tag or a column.
    """
    # Five formulas, then a number, a tag and a link.
    names = ("=cmd|' /C'!A0", "@sum", "-x", "+1e", "-1+cmd|' /C'!A0", "-1.5", "<script>", "[a](b)")
    file = tmp_path / "a.csv"
    table = Table(("name", "value"), [(name, 1.0) for name in names])
    Report("", records=table).save(file)
    cells = [row["name"] for row in csv.DictReader(file.read_text("utf-8").splitlines())]
    assert cells == [f"'{name}" for name in names[:5]] + list(names[5:])
    markdown = Report("", [table]).markdown()
    assert "&lt;script>" in markdown
    assert "[a]\\(b)" in markdown
    assert "=cmd\\|" in markdown


def test_every_line_of_the_provenance_fits_in_80_columns():
    """Long provenance is wrapped at blanks; only a path of 90 characters makes a longer line."""
    path = "x" * 90
    lines = replace(report(), source=f"version 1, plant {path}, " + "word " * 40).text().split("\n")
    assert [line for line in lines if len(line) > 80] == [f"{path},"]


def test_numbers_stand_in_columns_and_lists_in_lines(tmp_path):
    """In text, the first column of a table is aligned on the left, others on the right. In JSON, complex
    numbers are pairs, and an innermost list has its own line. A .csv file requires records.
    """
    made = report()
    assert made.text().count("\nlift <1>    2.5\na|b          10") == 1
    data = {"A": np.array([[1.0, 2.0], [3.0, 4.0]]), "roots": np.array([1.0 + 2.0j])}
    replace(made, data=data).save(tmp_path / "a.json")
    text = (tmp_path / "a.json").read_text("utf-8")
    assert json.loads(text) == {"A": [[1.0, 2.0], [3.0, 4.0]], "roots": [[1.0, 2.0]]}
    assert "\n  [ 1.0, 2.0 ],\n" in text
    with pytest.raises(BadInputError, match="not a table"):
        made.save(tmp_path / "a.csv")
    assert [eigenvalue_text(each) for each in (-1e-6 + 2j, 5e-5, 0.0)] == [
        "-1.0e-06 ± 2.0000i", "0.0001", "0.0000",
    ]  # fmt: skip
    assert labels_of(pd.DataFrame(np.eye(2), ["a", "b"])) == [("a", "b"), ()]
