"""Hostile inputs to commands. They give a result, or one line and no file.

`make fuzz` runs many more of them.
"""

from pathlib import Path

import pytest
from cli import hfa
from hostile import WAYS, attempt, hostile_case, seeds
from hypothesis import given, strategies as st

#: The command handles warnings as it does for users.
pytestmark = pytest.mark.filterwarnings("default")


@pytest.mark.slow
@pytest.mark.parametrize("way", WAYS)
@given(data=st.data())
def test_a_hostile_input_gives_a_result_or_error(way, data):
    """Every hostile variant of one kind of input gives a result, or an error of one line."""
    pytest.importorskip("hfa_flight")
    words, files = data.draw(hostile_case(way))
    assert attempt(words, files) is None  # otherwise the fault in words


@pytest.mark.parametrize("way", [way for way in WAYS if WAYS[way]])
def test_the_unchanged_file_is_accepted(way):
    """Each input file is accepted before it is corrupted. Its name takes the place of "{}" in words."""
    for name, content in seeds().items():
        Path(name).write_bytes(content)
    result = hfa(*(way if word == "{}" else word for word in WAYS[way]))
    assert (result.code, bool(result.out)) == (0, True), result.err
