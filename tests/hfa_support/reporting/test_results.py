"""Files of results: each format has every entry, and equal results give equal files."""

import csv
import enum
import json
import math
from collections import namedtuple
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pypdf import PdfReader
from scipy.io import loadmat

from hfa_support.errors import BadInputError
from hfa_support.reporting import figure
from hfa_support.reporting.report import Reported
from hfa_support.reporting.results import (
    ByValue,
    Entries,
    Result,
    save_data,
    storable,
)
from hfa_support.reporting.text import Table

pytestmark = pytest.mark.usefixtures("folder")


class Kind(enum.Enum):
    A = "a"


Pair = namedtuple("Pair", "x y")


@dataclass
class Part(Result):
    """A part of a result, whose second field is left out if it has no value."""

    value: complex
    note: str | None = None


@dataclass
class Whole(Part):
    """A result with a schema."""

    schema = "hfa.whole/1"
    inner: Part | None = None


#: A value, and the form in which files store it.
STORED = [
    (Part(1 + 2j), {"value": [1.0, 2.0]}),
    (Part(0.5, "n"), {"value": 0.5, "note": "n"}),
    (Whole(1, inner=Part(2)), {"schema": "hfa.whole/1", "value": 1, "inner": {"value": 2}}),
    (Pair(1, Kind.A), {"x": 1, "y": "a"}),
    ((1, [2, (3j,)]), [1, [2, [[0.0, 3.0]]]]),
    ({"a": Pair(1, None)}, {"a": {"x": 1, "y": None}}),
    (math.inf, math.inf),
    (Entries({"a": 1, "b": 2}, lambda: {"b": 3}, Part(4)), {"a": 1, "b": 3, "value": 4}),
]


@pytest.mark.parametrize(("value", "stored"), STORED)
def test_values_are_stored_as_lists_dictionaries_and_numbers(value, stored):
    """Complex numbers are pairs, results dictionaries, members of an Enum their values."""
    assert storable(value) == stored


DATA = {
    "schema": "hfa.test/1",
    "provenance": {"date": "2026"},
    "A": np.arange(4.0).reshape(2, 2),
    "stack": np.arange(8.0).reshape(2, 2, 2),
    "modes": [{"zeta": 0.5, "15.0": "x"}, {"zeta": None, "15.0": "y"}],
    "mixed": [{"a": 1.0}, {"b": 2.0}],
    "names": ["one", "two"],
    "single": ["one"],
    "structs": [{"a": 1.0}],
    "none": None,
    "empty": [],
}
RECORDS = Table(("name", "value"), [("=1", 1 / 3), ("-x", np.float64(np.nan)), ("é", 2)])


def test_a_mat_file_has_structs_and_matrices_behind_one_another():
    """Equal dictionaries are an array of structs, others and texts cells; N matrices have the shape
    (rows, columns, N); names begin with a letter.
    """
    save_data(Path("a.mat"), DATA, RECORDS)
    assert Path("a.mat").read_bytes()[:116].rstrip() == b"MATLAB 5.0 MAT-file, written by hfa"
    found = loadmat("a.mat", squeeze_me=True, struct_as_record=False)
    assert found["stack"][:, :, 1].tolist() == DATA["stack"][1].tolist()
    assert [mode.x15_0 for mode in found["modes"]] == ["x", "y"]
    assert found["modes"].dtype == object
    raw = loadmat("a.mat")
    assert (raw["modes"].dtype.names, raw["modes"].size) == (("zeta", "x15_0"), 2)
    assert raw["mixed"].shape == raw["names"].shape == (1, 2)
    assert raw["mixed"].dtype == raw["names"].dtype == object
    assert (found["provenance"].date, np.isnan(found["none"])) == ("2026", True)


def test_a_csv_file_has_records_and_its_origin_in_the_first_row():
    """Formulas become texts, numbers have all digits, and the last column is JSON in one row."""
    save_data(Path("a.csv"), DATA, RECORDS)
    rows = [*csv.reader(Path("a.csv").read_text("utf-8").splitlines())]
    assert rows[0] == ["name", "value", "about"]
    assert [row[:2] for row in rows[1:]] == [["'=1", repr(1 / 3)], ["'-x", "NaN"], ["é", "2"]]
    assert json.loads(rows[1][2]) == {"schema": "hfa.test/1", "provenance": {"date": "2026"}}
    assert [row[2] for row in rows[2:]] == ["", ""]


@dataclass(frozen=True, eq=False, repr=False)
class Shown(Reported, ByValue):
    """A result for the prompt.

    More about it.
    """

    matrix: np.ndarray
    long: np.ndarray
    pair: Pair
    number: float = 0.1 + 0.2
    nothing: str | None = None
    inner: object = None
    hidden: int = field(default=0, repr=False)


def test_a_dataclass_at_the_prompt_has_its_fields():
    """The report has the first line of the docstring, short values, and small matrices as tables."""
    shown = Shown(np.eye(2), np.zeros(13), Pair(1.0, (2.5, "t")))
    assert str(shown) == (
        "Shown: A result for the prompt.\n\n"
        "long: an array of shape (13,)\npair: x 1, y 2.5, t\nnumber: 0.3\n\n"
        "matrix       1       2\n1       1.0000  0.0000\n2       0.0000  1.0000"
    )
    large = Shown(np.zeros((13, 1)), np.zeros(2), Pair(1, 2), inner=shown)
    assert "matrix: an array of shape (13, 1)\nlong: 0, 0\npair: x 1, y 2" in str(large)
    assert "inner: Shown" in str(large)
    assert (
        "inner: object\n" in str(Shown(np.eye(2), np.zeros(2), Pair(1, 2), inner=object())) + "\n"
    )
    assert "nothing" not in str(large)
    with pytest.raises(BadInputError, match="Shown has no table of records; read its fields"):
        shown.to_pandas()
    assert shown._repr_html_().startswith("<h3>Shown: A result for the prompt.</h3>")


def drawn():
    """Return a figure whose title has dollars, with a logarithmic axis."""
    made = figure.new_figure(3.0, 2.0)
    axes = made.subplots()
    axes.set_title("a$b$")
    axes.semilogx([1.0, 1000.0], [0.0, 1.0])
    return made


@pytest.mark.parametrize("suffix", ["png", "svg", "pdf"])
def test_a_picture_has_its_origin_and_equal_bytes(suffix):
    """The origin is below the picture and in the metadata; two files are equal. Dollars in a name
    are no formula, powers of ten are.
    """
    for name in ("a", "b"):
        figure.save(drawn(), Path(f"{name}.{suffix}"), "from here")
    content = Path(f"a.{suffix}").read_bytes()
    assert content == Path(f"b.{suffix}").read_bytes()
    figure.save(drawn(), Path(f"plain.{suffix}"))
    if suffix == "png":
        with Image.open("a.png") as found, Image.open("plain.png") as plain:
            assert (found.info["Description"], found.size) == ("from here", (390, 260))
            assert plain.info.keys() == {"dpi"}
    elif suffix == "pdf":
        assert PdfReader("a.pdf").metadata.subject == "from here"
        text = PdfReader("a.pdf").pages[0].extract_text()
        assert ("from here" in text, "a$b$" in text, "10^" in text) == (True, True, False)
    else:
        assert b"<dc:description>from here<" in content
        assert (b"<!-- a$b$ -->" in content, b"<!-- from here -->" in content) == (True, True)
        assert b"from here" not in Path("plain.svg").read_bytes()
