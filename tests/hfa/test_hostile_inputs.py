"""Hostile inputs to commands. They give a result, or one line and no file.

`make fuzz` runs many more of them.
"""

from importlib.util import find_spec
from pathlib import Path

import pytest
from cli import hfa
from hostile import WAYS, attempt, hostile_case, seeds
from hypothesis import given, strategies as st

#: The command handles warnings as it does for users.
pytestmark = pytest.mark.filterwarnings("default")
IN_FILES = pytest.mark.skipif(
    not (find_spec("hfa_jsbsim") and find_spec("hfa_prove")),
    reason="the corrupted files include files of extensions",
)


def marks_of(way):
    """Return the marks of a kind of inputs. Those in files are slow: the files are made first."""
    return [IN_FILES, pytest.mark.slow] * bool(WAYS[way])


@pytest.mark.slow
@pytest.mark.parametrize("way", [pytest.param(way, marks=marks_of(way)) for way in WAYS])
@given(data=st.data())
def test_a_hostile_input_gives_a_result_or_error(way, data):
    """Every hostile variant of one kind of input gives a result, or an error of one line."""
    pytest.importorskip("hfa_flight")
    words, files = data.draw(hostile_case(way))
    assert attempt(words, files) is None  # otherwise the fault in words


@pytest.mark.parametrize(
    "way", [pytest.param(way, marks=marks_of(way)) for way in WAYS if WAYS[way]]
)
def test_the_unchanged_file_is_accepted(way):
    """Each input file is accepted before it is corrupted. Its name takes the place of "{}" in words."""
    for name, content in seeds().items():
        Path(name).write_bytes(content)
    result = hfa(*(way if word == "{}" else word for word in WAYS[way]))
    is_far = way.startswith("network")  # critics far from the exact solution fail
    assert result.code == (1 if is_far else 0), result.err
    assert result.out
