"""Rows of sheets, arrays and lists by name, in Python, text, Markdown, HTML and tables."""

import copy
import pickle

import numpy as np
import pytest

from hfa_support.errors import BadInputError
from hfa_support.reporting.rows import (
    Group,
    Lacking,
    Row,
    Sheet,
    with_names,
)

LONG = "a sentence that is longer than a value can be"


@pytest.mark.parametrize(
    ("row", "cells"),
    [
        (Row("a", 0.5, "rad", "n"), ("a", "28.65", "deg", "n")),
        (Row("a", 0.5, "rad/s", in_degrees=False), ("a", "0.5", "rad/s", "")),
        (Row("a", "text"), ("a", "text", "", "")),
        (Row("a", LONG), ("a", "", "", LONG)),
        (Row("a", -1.0 + 2.0j, "1/s"), ("a", "-1.0000 ± 2.0000i", "1/s", "")),
        (Row("a", -0.001, "m", least=0.01), ("a", "<= 0.01", "m", "")),
        (Row("a", 0.01, "m", least=0.01), ("a", "<= 0.01", "m", "")),
    ],
)
def test_a_row_prints_its_value_in_degrees_with_its_digits(row, cells):
    """Angles are in degrees; a value within rounding is "<= least", and a sentence is a note."""
    assert row.cells() == cells


@pytest.fixture
def sheet():
    """Return a sheet whose group "trim" has names that no title completes."""
    return Sheet.of(
        [
            (
                "limits",
                [Row("alpha", 0.2, "rad"), Lacking("q", "no table"), Row("mass", 9.0)],
                ["line"],
            ),
            (
                "trim",
                [Row("alpha", 0.1, "rad", "wide", 4, tone="bad"), Row("rare", 1.0, rare=True)],
                [],
            ),
            ("empty", [], []),
            (
                "modes",
                [Row("dutch", -1 + 2j, "1/s"), Row("mass", 8.0), Lacking("p", "no table")],
                [],
            ),
        ],
        "trim",
    )


def test_figures_of_a_sheet_are_found_by_name(sheet):
    """A name in two groups is completed by the title of the later one, or of the other than the
    first; what is missing is a sentence of its group, and the reason of its refusal.
    """
    assert sheet.keys() == ["alpha (limits)", "mass", "alpha", "rare", "dutch", "mass (modes)"]
    assert [group.title for group in sheet.groups] == ["limits", "trim", "modes"]
    assert sheet.groups[0].lines == ("line", "q: not in this model: no table")
    assert sheet["alpha"].value == 0.1
    assert sheet[1].value == 9.0
    assert dict(sheet.items())["mass"].value == 9.0
    for name, reason in (("p", "there is no p: no table"), ("mas", "did you mean mass")):
        with pytest.raises(BadInputError, match=reason):
            sheet[name]
    assert sheet.to_dict()["alpha"] == {
        **{"group": "trim", "value": 0.1, "unit": "rad", "note": "wide", "level": "below 3"}
    }


GROUP = Group(
    "trim", (Row("alpha", 0.1, "rad", "n" * 30, tone="bad"), Row("m", 22.5, "kg")), ("s",)
)


def test_a_group_as_text_has_columns_and_notes_beside_or_below():
    """Names are aligned left, values right; a note stands below its row if no room is beside it."""
    assert GROUP.text() == (
        f"trim   value  unit\nalpha   5.73  deg   {'n' * 30}\nm       22.5  kg\ns"
    )
    assert GROUP.text(width=40) == (
        f"trim   value  unit\nalpha   5.73  deg\n  {'n' * 30}\nm       22.5  kg\ns"
    )
    words = Group("g", (Row("a", 1.0, "m", "one two three four five six seven eight"),))
    assert words.text(width=44) == (
        "g  value  unit\na      1  m     one two three four five six\n                seven eight"
    )
    assert f"\x1b[31m{'n' * 30}\x1b[0m" in GROUP.text(color=True)
    assert Group("g", (), ("only",)).text() == "only"
    assert GROUP.table().header == ("trim", "value", "unit", "note")
    assert GROUP._replace(rows=GROUP.rows[1:]).table().rows == [("m", "22.5", "kg")]


def test_arrays_with_names_are_found_by_name_and_number():
    """Names index the last axes, also of copies and pickles; results of arithmetic have no names."""
    values = np.arange(12.0).reshape(2, 3, 2)
    named = with_names(values, ("a", "b"), ("x", "y", "z"), ("u", "v"))
    for each in (named, copy.copy(named), copy.deepcopy(named), pickle.loads(pickle.dumps(named))):
        assert each["y", "v"].tolist() == values[:, 1, 1].tolist()
        assert each["b", 2, "u"] == 10.0
    for wrong, said in ((named, "'w'; choose from u, v"), (named + 1.0, "'w'; choose from none")):
        with pytest.raises(BadInputError, match=f"unknown name {said}"):
            wrong["w"]
