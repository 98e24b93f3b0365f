"""--format: the same report as text, Markdown, LaTeX and HTML, from every command; --picture of a trim."""

from __future__ import annotations

import json
import re
from html.parser import HTMLParser
from pathlib import Path

import pytest
from cli import assert_refused, hfa

from hfa_cli.main import COMMANDS, DONE
from hfa_cli.options.shared_options import FORMATS

TRIM = ("trim", "--dihedral", "15")
#: Write pages or folders, not one report.
WITHOUT_FORMAT = ("report",)


def said(*words: str) -> str:
    result = hfa(*words)
    assert result.code == DONE
    return result.out


def cells(line: str) -> list[str]:
    return re.split(r" {2,}", line.strip())


def test_text_is_the_default() -> None:
    def unsigned(text: str) -> str:
        return text.rpartition("\n\n")[0]  # the last paragraph holds the date

    assert unsigned(said(*TRIM)) == unsigned(said(*TRIM, "--format", "text"))


def test_markdown_has_a_row_for_each_of_the_text() -> None:
    markdown = said(*TRIM, "--format", "markdown")
    assert markdown.startswith("# Trim, published dynamics: trimmed\n\n| state | value |")
    for line in said(*TRIM).splitlines():
        if line.startswith("rate of"):
            assert f"| {' | '.join(cells(line))} |" in markdown


def test_latex_has_a_row_for_each_of_the_text() -> None:
    latex = said(*TRIM, "--format", "latex")
    assert latex.startswith("\\section*{Trim, published dynamics: trimmed}\n\n\\noindent\\begin{tabular}{l")
    assert latex.count("\\begin{tabular}") == latex.count("\\end{tabular}") == 6
    assert re.search(r"^speed & 68\.00000 & ft/s & held & 1 & 500 & 67\.00000 & lowest \\\\$", latex, re.M)
    assert re.search(r"^pitch\\_rate & ", latex, re.M)
    for table in latex.split("\\begin{tabular}")[1:]:
        count = table.partition("}")[0].count("r") + 1
        rows = [line for line in table.partition("\\end{tabular}")[0].splitlines() if line.endswith("\\\\")]
        assert {len(re.findall(r"(?<!\\)&", row)) + 1 for row in rows} == {count}


def test_html_is_well_formed() -> None:
    class Counting(HTMLParser):
        def __init__(self) -> None:
            super().__init__()
            self.open: list[str] = []
            self.tables = 0

        def handle_starttag(self, tag: str, attrs: object) -> None:
            self.open.append(tag)
            self.tables += tag == "table"

        def handle_endtag(self, tag: str) -> None:
            assert self.open.pop() == tag

    page = Counting()
    page.feed(said(*TRIM, "--format", "html"))
    assert (page.open, page.tables) == ([], 6)


@pytest.mark.parametrize("form", FORMATS)
@pytest.mark.parametrize(
    "words", [("linearize", "--dihedral", "15"), ("solve", "--dihedral", "15"), ("sweep", "--dihedral", "5,15")]
)
def test_other_commands_have_it_too(words: tuple[str, ...], form: str) -> None:
    text = said(*words, "--format", form)
    opening = {"text": "", "markdown": "|---|", "latex": "\\begin{tabular}", "html": "<table>"}[form]
    assert opening in text
    assert not re.search(r"!\[|includegraphics", text)  # no picture lies beside it


@pytest.mark.parametrize("command", [name for name in COMMANDS if name not in WITHOUT_FORMAT])
def test_every_command_that_shows_a_report_offers_it(command: str) -> None:
    assert "--format FORMAT" in said(command, "--help")


def test_two_forms_at_once_are_refused() -> None:
    for form in FORMATS:
        assert_refused(hfa(*TRIM, "--json", "--format", form), 2, "--format not allowed with argument --json")
    assert_refused(hfa(*TRIM, "--format", "tex"), 2, "--format is 'tex'; use one of text, markdown, latex, html")


def test_a_file_is_the_same_whatever_is_printed(tmp_path: Path) -> None:
    for form in FORMATS:
        said(*TRIM, "--format", form, "-o", str(tmp_path / f"{form}.json"))
    data = [json.loads((tmp_path / f"{form}.json").read_text(encoding="utf-8")) for form in FORMATS]
    for each in data:
        del each["provenance"]
    assert all(each == data[0] for each in data)


@pytest.mark.parametrize(
    ("suffix", "begin"),
    [(".png", b"\x89PNG"), pytest.param(".svg", b"<?xml", marks=pytest.mark.slow), (".pdf", b"%PDF")],
)
def test_the_picture_of_a_trim(tmp_path: Path, suffix: str, begin: bytes) -> None:
    path = tmp_path / f"front{suffix}"
    said(*TRIM, "--picture", str(path))
    assert path.read_bytes().startswith(begin)
    assert b"hfa trim" in path.read_bytes() or b"published dynamics" in path.read_bytes()


def test_a_picture_that_cannot_be_written_is_refused(tmp_path: Path) -> None:
    assert_refused(hfa(*TRIM, "--picture", str(tmp_path / "front.jpg")), 2, "unknown suffix '.jpg'")
    assert_refused(hfa(*TRIM, "--picture", str(tmp_path / "none" / "front.png")), 2, "does not exist")
    assert list(tmp_path.iterdir()) == []
