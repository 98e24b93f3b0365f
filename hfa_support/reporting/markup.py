"""Reports as HTML, Markdown and LaTeX."""

from __future__ import annotations

import base64
import html
import re
from collections.abc import Iterator, Mapping
from itertools import groupby
from typing import Any

from hfa_support.errors import imported, printable
from hfa_support.reporting.parts import BLANKS, SIGNERS, Contents, Picture
from hfa_support.reporting.rows import Group
from hfa_support.reporting.text import Cell, Table, are_words, flowing, is_warning

#: Style sheet of a report in HTML, on a screen and on paper.
_STYLE = (
    "body{font:15px/1.5 sans-serif;max-width:60em;margin:2em auto;padding:0 1em;color:#111}"
    "table{border-collapse:collapse;margin:1em 0;font-variant-numeric:tabular-nums}"
    "th,td{padding:.2em .7em;border-bottom:1px solid #ccc;text-align:right}"
    "th:first-child,td:first-child{text-align:left}img{max-width:100%}"
    "h1{font-size:1.3em}h2{font-size:1.15em;border-top:2px solid #111;padding-top:.7em}"
    ".sheet{columns:2;column-gap:2em;font-size:11px;line-height:1.3}"
    ".sheet td:nth-child(2){white-space:nowrap}"
    ".sheet section{break-inside:avoid}.sheet table{width:100%;margin:.4em 0}"
    ".sheet th,.sheet td{padding:.1em .4em;font-weight:normal}.sheet p{margin:.2em 0}"
    ".sheet thead th{font-weight:bold;border-bottom:2px solid #111}"
    ".sheet .words{text-align:left}.sheet .note{color:#555}"
    ".signed{width:100%;font-size:11px;margin:.4em 0}"
    ".signed td,.signed th{border:1px solid #999;text-align:left}.signed th{width:8em}"
    ".table{overflow-x:auto;font-size:11px}.words{text-align:left}td.words{min-width:5em}"
    ".matrix{font-size:11px}.matrix th,.matrix td{padding:.2em .45em}.sheet td.words{min-width:0}"
    ".matrix td.words{min-width:9em}.matrix .words+.words{min-width:0}"
    ".table td:not(.words),.table th:first-child{white-space:nowrap}"
    ".bad{color:#c00000}.near{color:#9a6700}.good{color:#1a7f37}"
    "@page{size:A4;margin:12mm;@bottom-right{font:8px sans-serif;"
    "content:counter(page) ' of ' counter(pages)}}@media print{.sheet{font-size:8.5px}"
    "body{margin:0;max-width:none;font-size:11px}h2{break-before:page}table{break-inside:avoid}"
    ".matrix{page:wide}.matrix table,.matrix{font-size:8.5px}.table{overflow:visible}"
    ".part figure{display:none}}@page wide{size:A4 landscape}"
)


def markdown_of(report: Contents, level: int) -> str:
    """Return a report as Markdown without pictures.

    level: level of the heading, increased by one for each nested report
    """
    first, *others = printable(flowing(report.title), lines=True).split("\n")
    heading = [f"{'#' * level} {first}"] if first else []
    head = "\n".join(
        f"- {printable(': '.join(entry), lines=True)}" for entry in report.head.items()
    )
    parts = [_markdown(part, level) for part in report.parts if not isinstance(part, Picture)]
    notes = [printable(f"Note: {note}", lines=True) for note in report.notes]
    return "\n\n".join(filter(None, [*heading, *others, head, *parts, *notes, report.source]))


def _markdown(part: Any, level: int) -> str:
    """Return a part of a report as Markdown."""
    if isinstance(part, Contents):
        return markdown_of(part, level + 1)
    if isinstance(part, Group):
        part = (*([part.table()] if part.rows else []), *part.lines)
    if isinstance(part, Table):
        return markdown_table(part)
    if isinstance(part, str):
        return printable(part, lines=True)
    return "\n\n".join(_markdown(nested, level) for nested in part)


def markdown_table(table: Table) -> str:
    """Return a table as Markdown."""
    header, *body = (f"| {' | '.join(map(_cell, row))} |" for row in (table.header, *table.rows))
    return "\n".join([header, "|" + "---|" * len(table.header), *body])


def html_of(report: Contents, level: int, in_book: bool = False) -> str:
    """Return a report as an HTML fragment without styles.

    level: level of the heading, increased by one for each nested report
    in_book: whether it is a part of a book, whose cover alone has the lines for signatures
    """
    first, *others = flowing(report.title).split("\n")
    key = f' id="{report.anchor}"' if report.anchor else ""
    shown = [f"<h{level}{key}>{_escaped(first)}</h{level}>"] if first else []
    shown += [
        f'<p class="bad"><b>{_escaped(line)}</b></p>' if is_warning(line) else _paragraph(line)
        for line in others
    ]
    if in_book:
        shown.append('<div class="part">')
    if report.head:
        shown.append(_cover(report.head) if report.is_book else _signed_head(report.head, in_book))
    # Parts of a sheet have the type Group. The table of conditions in a book is in a tuple, with
    # sentences on the conditions.
    style_class = {Group: "sheet"} | ({tuple: "matrix"} if report.is_book else {})
    for kind, parts in groupby(report.parts, key=type):
        fragments = [
            html_of(part, level + 1, report.is_book) if isinstance(part, Contents) else _html(part)
            for part in parts
        ]
        if kind in style_class:
            fragments = [f'<div class="{style_class[kind]}">', *fragments, "</div>"]
        shown += fragments
    if in_book:
        shown.append("</div>")
    shown += [_paragraph(f"Note: {note}") for note in report.notes]
    shown += [_paragraph(line) for line in filter(None, report.source.split("\n"))]
    return "\n".join(shown)


def _html(part: Any) -> str:
    """Return a part of a report, which is no nested report, as HTML."""
    if isinstance(part, Picture):
        return figure_html(part)
    if isinstance(part, Group):
        return _group(part)
    if isinstance(part, Table):
        return _table(part)
    if isinstance(part, str):
        return "\n".join(map(_paragraph, part.split("\n")))
    return "\n".join(map(_html, part))


def figure_html(picture: Picture) -> str:
    """Return a picture with its text as caption."""
    data = base64.b64encode(picture.png).decode("ascii")
    text = _escaped(picture.text)
    image = f'<img alt="{text}" src="data:image/png;base64,{data}">'
    return f"<figure>{image}<figcaption>{text}</figcaption></figure>"


def _table(table: Table) -> str:
    """Return a table as HTML, in a box that is scrolled by pointer or keyboard. Classes are the
    tone of a cell, and `words` of a column of words.
    """
    columns = [  # classes of each column
        ["words"] if are_words([row[i] for row in table.rows]) else []
        for i in range(len(table.header))
    ]
    head = "".join(
        f'<th scope="col"{_class(words)}>{_escaped(cell)}</th>'
        for cell, words in zip(table.header, columns, strict=True)
    )
    body = "\n".join(
        f'<tr><th scope="row">{_linked(row[0])}</th>'
        + "".join(map(_td, row[1:], columns[1:]))
        + "</tr>"
        for row in table.rows
    )
    box = (
        '<div class="table" role="group" tabindex="0" aria-label="table:'
        f' {_escaped(table.header[0])}">'
    )
    return (
        f"{box}<table>\n<thead><tr>{head}</tr></thead>\n<tbody>\n{body}\n</tbody>\n</table></div>"
    )


def _signed_head(head: Mapping[str, str], is_part: bool) -> str:
    """Return the head of a sheet: its entries, and space to sign, unless the sheet is part of a
    book.
    """
    entries = "".join(f"<td><b>{_escaped(k)}</b><br>{_escaped(v)}</td>" for k, v in head.items())
    blanks = "".join(f"<td><b>{name}</b><br>&nbsp;</td>" for name in BLANKS)
    below = "" if is_part else f'<table class="signed"><tr>{blanks}</tr></table>'
    return f'<table class="signed"><tr>{entries}</tr></table>{below}'


def _cover(head: Mapping[str, str]) -> str:
    """Return the head of a book: its entries below each other, and space to sign."""
    entries = "".join(
        f'<tr><th scope="row">{_escaped(label)}</th><td>{_escaped(text)}</td></tr>'
        for label, text in head.items()
    )
    blanks = "".join(f"<td><b>{name}</b><br>&nbsp;</td>" for name in BLANKS)
    lines = "".join(f'<tr><th scope="row">{signer}</th>{blanks}</tr>' for signer in SIGNERS)
    return f'<table class="signed">{entries}</table><table class="signed">{lines}</table>'


def _group(group: Group) -> str:
    """Return rows of a sheet as HTML: a table whose head is the title, and its sentences below."""
    rows = []
    for row in group.rows:
        name, value, unit, note = map(_escaped, row.cells())
        tone = f' class="{row.tone}"' if row.tone else ""
        noted = f'<td class="words note"><span{tone}>{note}</span></td>'
        cells = f'<td>{value}</td><td class="words">{unit}</td>{noted}'
        rows.append(f'<tr><th scope="row">{name}</th>{cells}</tr>')
    title = _escaped(group.title)
    head = f'<thead><tr><th scope="col" colspan="4">{title}</th></tr></thead>'
    table = f"<table>\n{head}\n<tbody>\n" + "\n".join(rows) + "\n</tbody>\n</table>"
    lines = [_paragraph(line) for line in group.lines]
    return "\n".join(['<section class="rows">', *([table] if rows else []), *lines, "</section>"])


def _linked(cell: Any) -> str:
    """Return the text of a cell as HTML, with the link of the cell if it has one."""
    link = getattr(cell, "link", "")
    return f'<a href="#{link}">{_escaped(cell)}</a>' if link else _escaped(cell)


def _td(cell: Any, column: list[str]) -> str:
    """Return a cell as HTML, with its tone as a class beside the classes of its column."""
    tone = [cell.tone] if isinstance(cell, Cell) and cell.tone else []
    return f"<td{_class([*column, *tone])}>{_escaped(cell)}</td>"


def _class(names: list[str]) -> str:
    """Return the attribute `class` of an element, or "" without a name."""
    return f' class="{" ".join(names)}"' if names else ""


def _cell(cell: Any) -> str:
    """Return the text of a table cell in Markdown, without characters that would begin a column,
    tag or link.
    """
    text = re.sub(r"<(?=[A-Za-z/!])", "&lt;", printable(cell))
    return text.replace("|", "\\|").replace("](", "]\\(")


def _escaped(text: Any) -> str:
    """Return a text for HTML, with special characters and control characters escaped."""
    return html.escape(printable(text))


def _paragraph(line: str) -> str:
    """Return a line as an HTML paragraph, in which text in backquotes is shown as code."""
    text = re.sub("`([^`]+)`", r"<code>\1</code>", _escaped(line))
    return f"<p>{text}</p>"


def as_page(fragment: str) -> str:
    """Return a page in HTML with styles that contains a fragment."""
    return f'<!doctype html>\n<meta charset="utf-8">\n<style>{_STYLE}</style>\n{fragment}'


#: Character with a meaning in LaTeX -> how it is printed.
_ESCAPED = {character: f"\\{character}" for character in "&%$#_{}"} | {
    "\\": r"\textbackslash{}",
    "~": r"\textasciitilde{}",
    "^": r"\textasciicircum{}",
    "<": r"\textless{}",
    ">": r"\textgreater{}",
}


def latex_of(report: Contents) -> str:
    r"""Return a report as LaTeX that \input places in a document: its lines and notes are
    paragraphs, its tables `tabular`. Requires pandas and Jinja2.
    """
    first = printable(report.title)
    return "\n".join([f"% {first}", *_blocks(report)])


def _blocks(part: Any) -> Iterator[str]:
    """Yield tables and paragraphs of a part, and of the parts in it, in reading order."""
    if isinstance(part, Group):
        if part.rows:
            yield _tabular(part.table())
        yield from map(_latex_paragraph, part.lines)
    elif isinstance(part, Table):
        yield _tabular(part)
    elif isinstance(part, str):
        yield from map(_latex_paragraph, filter(None, flowing(part).split("\n")))
    elif isinstance(part, (tuple, list)):
        for nested in part:
            yield from _blocks(nested)
    elif isinstance(part, Contents):
        yield from _blocks(part.title)
        yield from (_latex_paragraph(f"{label}: {text}") for label, text in part.head.items())
        yield from _blocks(tuple(part.parts))
        yield from (_latex_paragraph(f"Note: {note}") for note in part.notes)
        yield from _blocks(part.source)


def _latex_paragraph(text: str) -> str:
    """Return a sentence as a paragraph."""
    escaped = "".join(_ESCAPED.get(character, character) for character in printable(text))
    return f"\\noindent {escaped}\n"


def _tabular(table: Table) -> str:
    """Return a table, with columns of words aligned left and others right."""
    imported("jinja2", "LaTeX files require")
    pandas = imported("pandas", "LaTeX files require")
    cells = [[str(cell) for cell in row] for row in table.rows]
    style = pandas.DataFrame(cells, columns=list(table.header)).style.hide(axis="index")
    style = style.format(escape="latex").format_index(escape="latex", axis=1)
    columns = zip(*cells, strict=True) if cells else ((),) * len(table.header)
    alignment = "".join(
        "l" if index == 0 or are_words(column) else "r" for index, column in enumerate(columns)
    )
    return str(style.to_latex(hrules=True, column_format=alignment))
