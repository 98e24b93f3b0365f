"""Reports as text, Markdown, HTML and data files, with every text escaped."""

import csv

import pytest

from hfa import BadInputError
from hfa.extend import Report, Table
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.parts import Picture
from hfa_support.reporting.text import Cell


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


def test_a_report_without_records_has_no_csv(tmp_path):
    """A .csv file requires records."""
    with pytest.raises(BadInputError, match="not a table"):
        report().save(tmp_path / "a.csv")


def test_a_book_in_html_has_a_cover_links_and_parts():
    """The cover has head and lines to sign; a cell links to its report; words and tones are classes;
    a warning is bold; each part has a frame, and its head no lines to sign.
    """
    table = Table(("name", "x", "note"), [(Cell("one", link="c1"), Cell("1", "bad"), "a `b`")])
    draw = lambda: new_figure(1.0, 1.0)  # noqa: E731
    inner = Report("one\nSTALLED: CL", ["text\nmore"], head={"data": "<file>"}, anchor="c1")
    sheet = Report("two", [Picture("p", "a & b", draw)], head={"data": "file"})
    html = Report("Book", [(table, "below"), inner, sheet], head={"document": "12"}).html()
    cover, _, rest = html.partition('<div class="matrix">')
    assert cover.startswith(
        '<h1>Book</h1>\n<table class="signed"><tr><th scope="row">document</th>'
    )
    blanks = "".join(
        f"<td><b>{blank}</b><br>&nbsp;</td>" for blank in ("name", "date", "signature")
    )
    for signer in ("author", "checked", "approved"):
        assert f'<tr><th scope="row">{signer}</th>{blanks}</tr>' in cover
    matrix, one, two = rest.split("<h2")
    assert '<th scope="row"><a href="#c1">one</a></th><td class="bad">1</td>' in matrix
    assert '<td class="words">a `b`</td>' in matrix
    assert '<th scope="col">x</th><th scope="col" class="words">note</th>' in matrix
    assert matrix.endswith("<p>below</p>\n</div>\n")
    assert one == (
        ' id="c1">one</h2>\n<p class="bad"><b>STALLED: CL</b></p>\n<div class="part">\n'
        '<table class="signed"><tr><td><b>data</b><br>&lt;file&gt;</td></tr></table>\n'
        "<p>text</p>\n<p>more</p>\n</div>\n"
    )
    assert '<figure><img alt="a &amp; b" src="data:image/png;base64,iVBOR' in two
    assert "<figcaption>a &amp; b</figcaption></figure>" in two
    assert "&nbsp;" not in matrix + one + two
    alone = sheet.html()
    assert f'<table class="signed"><tr>{blanks}</tr></table>' in alone
    assert '<div class="part">' not in alone
    assert "<code>b</code>" in Report("", ["a `b`"], source="s").html()
    assert Report("", ["a"], ["n"], source="s").html() == "<p>a</p>\n<p>Note: n</p>\n<p>s</p>"
    assert (
        Report("t", [sheet], head={"data": "f"}).markdown()
        == "# t\n\n- data: f\n\n## two\n\n- data: file"
    )
