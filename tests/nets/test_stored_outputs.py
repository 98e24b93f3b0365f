"""Outputs of commands equal the stored ones: a net under changes that must leave them alone.

The stored files change in a commit that changes nothing else and says what differs, and why.
"""

import re

import pytest
from stored_outputs import OUTPUTS, cases, machine, prepare, stored

#: Largest relative difference of two numbers that are called equal.
EQUAL = 1e-6


@pytest.fixture(scope="module")
def inputs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("inputs")
    prepare(folder)
    return folder


def difference(now, before, path):
    """Return a line for each number, text or missing value in which two outputs differ.

    now, before: number, text, None or list of these; a number is compared up to `EQUAL`, a text
        without bounds of roundoff (4e-22), which differ between processors
    path: place of the value, for the line
    """
    if isinstance(before, list) and isinstance(now, list) and len(now) == len(before):
        pairs = zip(now, before, strict=True)
        return [line for one, other in pairs for line in difference(one, other, path)]
    if isinstance(before, float) and isinstance(now, int | float):
        if now == before or abs(now - before) <= EQUAL * max(abs(now), abs(before), 1e-6):
            return []
    elif now == before or re.sub(r"\de-\d+", "#", str(now)) == re.sub(r"\de-\d+", "#", str(before)):
        return []
    return [f"{path}: {now!r} instead of {before!r}"]


@pytest.mark.parametrize("name", cases()["json"])
def test_json_has_the_stored_keys_and_numbers(name, inputs):
    """The exit code, the keys and, up to 1e-6, the numbers of the JSON of a command are the stored
    ones.
    """
    before = stored("json")[name]
    now = OUTPUTS["json"](cases()["json"][name], inputs)
    assert sorted(set(now) ^ set(before)) == []
    lines = [line for path in before for line in difference(now[path], before[path], path)]
    assert lines == []


@pytest.mark.slow
@pytest.mark.parametrize("name", cases()["flights"])
def test_a_flight_equals_the_stored_one(name, inputs):
    """A flight equals the stored one bit for bit on the machine that stored it, and elsewhere at
    its end up to 1e-5. Floats are stored in hexadecimal digits.
    """
    before = stored("flights")[name]
    now = OUTPUTS["flights"](cases()["flights"][name], inputs)
    assert sorted(set(now) ^ set(before)) == []
    if machine() == stored("flights")["machine"]:
        assert now == before
    for array in set(before) - {"exit"}:
        ends = zip(now[array]["last"], before[array]["last"], strict=True)
        pairs = [(float.fromhex(one), float.fromhex(other)) for one, other in ends]
        assert [pair for pair in pairs if pair[0] != pytest.approx(pair[1], 1e-5, 1e-5)] == []


@pytest.mark.slow
@pytest.mark.parametrize("name", cases()["certificates"])
def test_no_changed_certificate_is_accepted_that_was_refused(name, inputs):
    """A stored certificate is accepted, and each copy with one changed entry is accepted or refused
    as stored. Changes that were accepted leave the claim true, as a wider limit of an unused
    variable.
    """
    assert (
        OUTPUTS["certificates"](cases()["certificates"][name], inputs)
        == stored("certificates")[name]
    )


@pytest.mark.parametrize("name", cases()["help"])
def test_help_equals_the_stored_text(name, tmp_path):
    """The help text of a command is the stored one."""
    assert OUTPUTS["help"](cases()["help"][name], tmp_path) == stored("help")[name]
