"""Files of certificates: edits, digests of equations, and entries that are the user's."""

from dataclasses import replace
from functools import cache

import casadi as ca
import numpy as np
import pytest
from proofs import CONSTANT, FLOAT, certificate, changed

from hfa import BadInputError, NoSolutionError, aircraft
from hfa_prove import Family, prove_schedule
from hfa_prove.certificate import read_certificate, read_content, write_certificate
from hfa_prove.fields import Given, compare
from hfa_prove.report import found_report
from hfa_prove.statements.schedule import digest_of, facts


@cache
def found():
    """Return the proof of a decay rate of the float, 0.5 1/s."""
    return prove_schedule(Family(FLOAT), CONSTANT, 1.0, 1.5, decay_rate=0.5)


@pytest.mark.parametrize(
    ("before", "after"),
    [
        ('"decay_rate": 0.5', '"decay_rate": 0.4'),
        ('"pieces": ', '"pieces": 1'),
        ('"date": "today"', '"date": "monday"'),
        ('"digest": "', '"digest": "0'),
        ('"kind": "schedule"', '"kind": "other", "kind": "schedule"'),
        ('"decay_rate": 0.5', '"decay_rate": 0.4, "decay_rate": 0.5'),
        ('"decay_rate": 0.5', '"decay_rate": 0.50'),
    ],
)
def test_a_certificate_that_was_edited_is_refused(before, after, tmp_path):
    """Any edit of the text is refused: another value, another digest, a second entry of the same name,
    and a value with another number of digits.
    """
    path = tmp_path / "schedule.json"
    origin = {"version": "1", "command": "hfa prove schedule", "date": "today"}
    write_certificate(path, found().statement, found().witness, origin)
    assert read_certificate(path, FLOAT).written == origin
    text = path.read_text()
    assert text.count(before) == 1
    path.write_text(text.replace(before, after))
    with pytest.raises(BadInputError, match="edited"):
        read_certificate(path, FLOAT)


def test_a_certificate_of_other_code_is_refused(tmp_path, monkeypatch):
    """A certificate that another program made is refused with the identities of both programs."""
    path = tmp_path / "schedule.json"
    origin = {"version": "1", "command": "hfa prove schedule", "date": "today"}
    write_certificate(path, found().statement, found().witness, origin)
    monkeypatch.setattr("hfa_prove.certificate.toolchain", lambda: "0.4.0+0123456789ab")
    with pytest.raises(BadInputError, match=r"made by hfa .*, but this is 0\.4\.0\+0123456789ab"):
        read_certificate(path, FLOAT)


def test_different_functions_have_different_digests():
    """Functions that differ in the last digit of a coefficient or of a value of a table, in the state
    z[0] or z[1], or in which of two tables they apply to a state, have different digests.
    """
    z = ca.SX.sym("z", 2)
    near = np.nextafter(0.25, 1.0)
    tables = [ca.interpolant("u", "linear", [[0.0, 1.0]], [0.0, v]) for v in (0.25, near)]
    results = [0.25 * z[0], near * z[0], 0.25 * z[1], *(table(z[0]) for table in tables)]
    results += [tables[k](z[0]) - tables[1 - k](z[1]) for k in range(2)]
    functions = [ca.Function("u", [z], [result]) for result in results]
    assert len({digest_of(function, "u") for function in functions}) == 7


def test_a_certificate_about_an_aircraft_file_requires_the_file():
    """A certificate about other equations with the name "published" is refused without the file that
    has them: the built-in aircraft of this name is not its subject.
    """
    content = certificate(found().statement, found().witness.content())
    model = facts(aircraft()) | {"equations": "0" * 64}  # the digest of other equations
    with pytest.raises(BadInputError, match="equations of its own"):
        read_content(changed(content, statement__flight__model=model))


def test_more_entries_than_the_users_are_refused():
    """A statement with an entry that the user does not have is about another aircraft."""
    # The statement has pull and drag.
    with pytest.raises(NoSolutionError, match="drag in the certificate differs"):
        compare(found().statement, {"flight.parameters": Given({"pull": 1.0})})


def test_a_stated_rate_is_rounded_down():
    """The first line says at most what is proved: 0.1234567 1/s is 0.123456."""
    lower = replace(found().statement, decay_rate=0.1234567)
    assert "decays by 0.123456 1/s" in found_report(lower, 1).title
