"""Entries of users' files: each is checked against its declaration."""

import math

import pytest

from hfa_support import files
from hfa_support.errors import BadInputError
from hfa_support.files import NUMBER, POSITIVE, Number, checked

#: Declaration of a number -> its words, values within it, and values outside.
NUMBERS = {
    NUMBER: ("a finite number", [0, -1.5, 1e308], [math.nan, math.inf, True, "1", 10**400, None]),
    POSITIVE: ("a finite number above 0", [5e-324, 2], [0.0, -1.0, math.inf]),
    Number(0.0): ("a finite number of at least 0", [0.0, 1], [-5e-324]),
    Number(0.0, 2.0): ("a finite number of at least 0, at most 2", [0, 2.0], [2.1, -1]),
    Number(1.5, above=True, infinite=True): ("a number above 1.5", [math.inf, 2.0], [1.5]),
}


@pytest.mark.parametrize("declared", NUMBERS, ids=str)
def test_a_number_is_within_its_limits(declared):
    """A number is converted to a float; one outside of its limits is refused with them."""
    words, inside, outside = NUMBERS[declared]
    for value in inside:
        found = checked("a.toml", value, declared, "x")
        assert (type(found), found) == (float, value)
    for value in outside:
        assert declared.of(value) is None
        with pytest.raises(BadInputError, match=rf"^a\.toml: x is .*; give {words}$"):
            checked("a.toml", value, declared, "x")


TABLE = {
    "name*": str,
    "kind": ("a", "b"),
    "one": ("only",),
    "sizes": [NUMBER],
    "rows": [[POSITIVE]],
    "names": [str],
    "inner*": {"x": NUMBER},
    "more": {str: POSITIVE, "special": str},
    "free": {"x": NUMBER, ...: None},
    "any": None,
}
RIGHT = {
    "name": "n",
    "kind": "b",
    "one": "only",
    "sizes": [1, 2],
    "rows": [[1], []],
    "names": ["a"],
    "inner": {"x": 3},
    "more": {"a": 1, "special": "text"},
    "free": {"x": 1, "y": "anything"},
    "any": [None],
}


@pytest.mark.parametrize(
    ("changes", "said"),
    [
        ({"name": 3}, "name is 3; give a text in quotes"),
        ({"kind": "c"}, "kind is 'c'; give one of a, b"),
        ({"one": "two"}, "one is 'two'; give only"),
        ({"sizes": 1.0}, "sizes is 1.0; give a list of numbers"),
        ({"sizes": [1.0, "2"]}, "sizes[1] is '2'; give a finite number"),
        ({"rows": 1}, "rows is 1; give a list of lists of numbers"),
        ({"rows": [[1.0], [-1.0]]}, "rows[1][0] is -1.0; give a finite number above 0"),
        ({"names": "a"}, "names is 'a'; give a list of names in quotes"),
        ({"inner": 1}, "inner is 1; give a table [inner]"),
        ({"inner": {"y": 1}}, "unknown entry inner.y; choose from x"),
        ({"inner": {"x": "1"}}, "inner.x is '1'; give a finite number"),
        ({"more": {"a": 0}}, "more.a is 0; give a finite number above 0"),
        ({"more": {"special": 0}}, "more.special is 0; give a text in quotes"),
        ({"kin": 1}, "unknown entry kin; did you mean kind? choose from name, kind"),
        ({"\x1b": 1}, "unknown entry \\x1b; choose from"),
        ({"name": None}, "name is None"),
    ],
)
def test_a_wrong_entry_is_refused_with_its_place(changes, said):
    """The message has the file, the place of the entry, its value and what it must be."""
    with pytest.raises(BadInputError) as refused:
        checked("a.toml", RIGHT | changes, TABLE)
    assert str(refused.value).startswith(f"a.toml: {said}")


@pytest.mark.parametrize(
    ("content", "said"),
    [
        ("<a>\n<b></a>", r"^f:2: the file is not valid XML \(mismatched tag\); correct"),
        ("<a>" * 150 + "</a>" * 150, ""),
        ("<a>\n" * 151 + "</a>" * 151, "^f:151: more than 150 levels of nested elements"),
        ('<!DOCTYPE a [<!ENTITY b SYSTEM "c">]><a>&b;</a>', "^f:1: the file is not valid XML"),
        ('<?xml version="1.0" encoding="x"?><a/>', "^f(:1)?: the .* encoding"),
    ],
)
def test_faulty_xml_is_refused_with_its_line(content, said):
    """Files that are not well formed, nested too deeply or refer to others are refused."""
    if not said:
        assert files.xml_root(content.encode(), "f").tag == "a"
        return
    with pytest.raises(BadInputError, match=said):
        files.xml_root(content.encode(), "f")


def test_too_many_xml_elements_are_refused(monkeypatch):
    """Attributes count as elements do."""
    monkeypatch.setattr(files, "_MOST_XML_ENTRIES", 3)
    assert files.xml_root(b'<a x="1"><b/></a>', "f").tag == "a"
    with pytest.raises(BadInputError, match="more than 3 elements and attributes"):
        files.xml_root(b'<a x="1"><b/><c/></a>', "f")
