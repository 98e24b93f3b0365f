"""Files of results: each format has every entry, and equal results give equal files."""

import enum
import math
from collections import namedtuple
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from pypdf import PdfReader
from scipy.io import loadmat

from hfa_support.reporting import figure
from hfa_support.reporting.results import (
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
