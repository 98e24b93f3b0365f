"""Numbers and tables as text."""

import math

import pytest

from hfa_support.reporting import text

#: Function of hfa_support.reporting.text -> arguments and the printed text.
PRINTED = {
    "with_unit": [
        ((0.5, "m"), "0.5 m"),
        ((15.0, "rad"), "859.437 deg (15 rad)"),
        ((-7.0, "rad"), "-401.07 deg (-7 rad)"),
        ((6.0, "rad"), "343.775 deg"),
        ((15.0, "rad/s"), "859.437 deg/s"),
        ((1e-10, "m", 1e3), "0 m"),
    ],
    "short_number": [
        ((12345.6, "m"), "12346"),
        ((1234.56, "m"), "1235"),
        ((0.00123456, "m"), "0.001235"),
        ((12345678.0, "m"), "1.235e+07"),
        ((1.0, "rad", 3), "57.3"),
        ((-1e-14, "m"), "0"),
    ],
    "digits": [
        ((40_000.4,), "40,000"),
        ((999.4,), "999"),
        ((-0.00012345,), "-0.000123"),
        ((1234.5, 5), "1,234.5"),
        ((1234.5, 2), "1,234"),
        ((-0.0,), "0"),
    ],
    "digits_with_unit": [
        ((40_000.4, "ft"), "40,000 ft"),
        ((1.0, "rad"), "57.3 deg"),
        ((1e-13, "ft"), "0 ft"),
        ((1e-10, "ft", 3, 1e3), "0 ft"),
    ],
    "percent": [
        ((634.2,), "634 %"),
        ((31.23,), "31 %"),
        ((0.0000753,), "7.5e-05 %"),
        ((99.6,), "100 %"),
        ((0.0,), "0 %"),
        ((-0.0,), "0 %"),
        ((math.inf,), "inf %"),
        ((2e6,), "2e+06 %"),
        ((-12.34, 3), "-12.3 %"),
    ],
    "eigenvalue_text": [
        ((-1e-6 + 2j,), "-1.0e-06 ± 2.0000i"),
        ((1.0 - 2e-5j,), "1.0000 ± 2.0e-05i"),
        ((0.0,), "0.0000"),
        ((0.00006,), "0.0001"),
    ],
}  # fmt: skip


@pytest.mark.parametrize("function", PRINTED)
def test_numbers_are_printed_with_their_digits_and_units(function):
    """Angles are printed in degrees, rounding errors as 0, and small numbers with an exponent."""
    for arguments, expected in PRINTED[function]:
        assert getattr(text, function)(*arguments) == expected, arguments


def test_columns_are_aligned_colored_and_broken_into_blocks():
    """The first column is aligned left, the others right; a cell with a tone is colored if color is
    asked for; columns that do not fit follow below, with the labels again.
    """
    rows = [("lift", "1", text.Cell("good", "good")), ("a", "22.5", "x")]
    header = ("name", "value", "note")
    assert text.columns(header, rows) == "name  value  note\nlift      1  good\na      22.5     x"
    colored = text.columns(header, rows, color=True)
    assert "  \x1b[32mgood\x1b[0m" in colored
    narrow = text.columns(header, rows, width=12)
    assert narrow == "name  value\nlift      1\na      22.5\n\nname  note\nlift  good\na        x"
