"""Answers of commands equal the stored ones: a net over all that a user reads."""

import pytest
from references import answer_of, differences, rounded, stored

ANSWERS, _ = stored("trim/reports")


@pytest.mark.parametrize("line", ANSWERS)
def test_an_answer_is_the_stored_one(line, folder):
    """Exit code, words, numbers and drawings of a command are those of `references.json`."""
    assert differences(rounded(answer_of(line, folder)), ANSWERS[line]) == []
