"""The study `python -m studies.validation`: exit codes, data and refusals."""

import json

import pytest

from hfa.main import BAD_INPUT, DONE, FAILED
from studies.alone import run_alone
from studies.validation.__main__ import validation


@pytest.mark.parametrize(
    ("words", "code"),
    [
        ("--json", DONE),
        ("--json --parameters gibson-2011-simulation", FAILED),
        ("--dynamics unsteady", BAD_INPUT),
    ],
)
def test_the_exit_code_agrees_with_the_verdict(words, code, capsys):
    """The exit code of the study agrees with the verdict in its JSON data."""
    assert run_alone(validation, "python -m studies.validation", words.split()) == code
    text, said = capsys.readouterr()
    if code == BAD_INPUT:
        assert text == ""
        assert "the condition is for published; give a condition for unsteady" in said
        return
    data = json.loads(text)
    assert data["ok"] == (code == DONE)
    assert data["provenance"]["command"].startswith("python -m studies.validation")
