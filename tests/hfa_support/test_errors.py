"""What a message repeats of what was given."""

from __future__ import annotations

from hfa_support.errors import on_one_line, shown


def test_control_characters_are_spelled_and_lines_joined() -> None:
    assert on_one_line("a\x1b[31m b\n  c\td") == "a\\x1b[31m b c d"
    assert len(on_one_line("x" * 100_000)) < 2000


def test_numbers_that_python_does_not_write_are_said() -> None:
    assert shown(10**5000) == "a number of thousands of digits"
    assert shown("a") == "'a'"
