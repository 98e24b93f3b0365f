"""The document of several trims: nothing that a trim says is lost on its pages."""

import re

import pypdf
import pytest
from cli import hfa as command

import hfa

#: A stall (CL above CL_max = 1, which the fixture `uav` adds), a warning about the inertias, a
#: condition without a trim, and a trim.
CONDITIONS = """name,speed,altitude,Ixz,gamma,thrust,free
stall,18.5,100,,,,
planted,35,100,1.19,,,
too slow,8,100,,,,
climb,30,100,,,60,gamma
"""
#: Conditions with a trim.
NAMES = ("stall", "planted", "climb")


@pytest.fixture(scope="module")
def written(uav, tmp_path_factory):
    """Return the function that writes the book of the conditions to a file of a name, and returns
    its path. One condition has no trim: exit code 1.
    """
    folder = tmp_path_factory.mktemp("book")
    (folder / "book.csv").write_text(CONDITIONS, "utf-8")
    files = ("--aircraft", uav, "--conditions", str(folder / "book.csv"))

    def write(name):
        document = ("--document", "TR-12, revision B", "-o", str(folder / name))
        assert command("trim", *files, "-q", *document).code == 1
        return folder / name

    return write


@pytest.fixture(scope="module")
def pages(written):
    """Return the texts of the pages of the PDF, without blanks."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "1700000000")
        read = pypdf.PdfReader(written("book.pdf"))
    assert read.metadata.subject == "TR-12, revision B"
    assert read.metadata.creation_date.date().isoformat() == "2023-11-14"
    return ["".join(page.extract_text().split()) for page in read.pages]


def test_the_cover_names_document_aircraft_mass_and_results(pages):
    """The cover has the document, the aircraft, digests of the files, mass, date, results of all
    conditions and places for signatures. The texts of pages are compared without blanks.
    """
    for text in (
        "documentTR-12,revisionB",
        "aircraftAerosonde(derivatives)",
        "uav.toml(SHA-256",
        "book.csv(SHA-256",
        "mass13.5kgairplaneclassI(",
        "flightphasecategoryBatmosphereU.S.Standard1976",
        "stalled1stallwithawarning2plantednotrim3tooslowissued2023-11-14",
        "1of4conditionsaretrimmed,1stalled,1withawarning,1withoutatrim",
        "authorcheckedapproved",
        "signature",
    ):
        assert text in pages[0]


def test_the_table_of_a_book_has_the_result_of_each_condition(pages):
    """The table on the second page has a row for each condition, with the thrust and its share of the
    60 N (all of it in the climb, 31 % in another trim), with the inertia Ixz that one condition sets,
    and with the reason of a stall, a warning or a missing trim. Texts are without blanks.
    """
    matrix = pages[1]
    for number, name in enumerate(("stall", "planted", "tooslow", "climb"), start=1):
        assert f"{number}{name}" in matrix
    for text in ("60(100%)", "18.85(31%)", "Ixz[kgm^2]", "1.19"):
        assert text in matrix
    for said in ("stalled", "STALLED:CL", "principalmoment", "giveavaluebetween", "notrim"):
        assert said in matrix


def lost(sheet, text):
    """Return the printed rows of a sheet that are not in the text of a page without blanks."""
    rows = [row for group in sheet.shown(full=False) for row in group.rows]
    return [row.name for row in rows if "".join("".join(row.cells()).split()) not in text]


def test_each_trim_has_a_numbered_page_with_all_its_rows(pages, uav, tmp_path):
    """Each trim has a page with all rows of its sheet. `lost` returns the rows that are missing, here
    the mass if it is removed from the text of the page, which is without blanks.

    Only the page of the stall says STALLED, and only that of the planted inertia has a warning.
    """
    assert len(pages) == 2 + len(NAMES)  # cover and matrix
    for number, text in enumerate(pages, start=1):
        assert f"{number}of{len(pages)}" in text
    (tmp_path / "book.csv").write_text(CONDITIONS, "utf-8")
    trims = hfa.conditions(hfa.load_model(uav), tmp_path / "book.csv")
    for name, text in zip(NAMES, pages[2:], strict=True):
        sheet = trims[name].sheet
        assert not lost(sheet, text)
        assert f"{name}:Aerosonde" in text
        assert "mass" in "".join(lost(sheet, text.replace("13.5kg", "")))
        assert ("STALLED" in text) == (name == "stall")
        assert ("Check:" in text) == (name == "planted")


def test_the_book_in_html_has_the_stall_the_warning_and_links(written):
    """The HTML has document, stall, warning and advice, and its table links to each sheet.

    Each sheet states which limit is assumed.
    """
    html = written("book.html").read_text("utf-8")
    for said in (
        "TR-12, revision B",
        "STALLED: CL",
        "principal moment",
        "a value between",
        "<figure",
    ):
        assert said in html
    assert html.count("assumed: no data of the aircraft") == len(NAMES)
    links = set(re.findall('href="#([^"]+)"', html))
    assert links == set(re.findall(r'<h2 id="([^"]+)"', html))
    assert len(links) == len(NAMES)


def test_the_book_in_latex_has_its_sheets_in_escaped_text(written):
    """The LaTeX has the stall and the share of the thrust; a percent sign, which would begin a comment, and
    an underscore are escaped, and braces are in pairs.
    """
    text = written("book.tex").read_text("utf-8")
    for said in ("STALLED: CL", r"18.85 (31 \%)", *NAMES):
        assert said in text
    _, _, body = text.partition("\n")  # below the comment with the title
    assert not re.search(r"(?<!\\)[%_]", body)
    assert body.count("{") == body.count("}")
