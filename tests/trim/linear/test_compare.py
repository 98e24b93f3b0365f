"""`hfa linearize` shows the print beside the model at the printed flight conditions, and nowhere else."""

from __future__ import annotations

from dataclasses import replace

import pytest
from known_models import model_at

from hfa_model import Aircraft, published_models
from trim import OperatingPoint, regenerate
from trim.linear.compare import EntryRow, entries_records, entries_table, matrices_beside_the_print, printed_at


@pytest.mark.parametrize("degrees", [model.dihedral_deg for model in published_models()])
def test_at_a_printed_angle_it_is_that_print(aircraft: Aircraft, degrees: float) -> None:
    printed = printed_at(model_at(degrees, aircraft.variant.name).point)
    assert printed is not None
    assert printed.dihedral_deg == degrees


@pytest.mark.parametrize("name", ["speed", "alpha", "altitude", "pitch", "pitch_rate", "dihedral", "dihedral_rate"])
def test_one_state_aside_there_is_no_print(point: OperatingPoint, name: str) -> None:
    """Each state but the rest as printed; a rounding error still counts as printed."""
    value = getattr(point.states, name)
    assert printed_at(replace(point, states=point.states._replace(**{name: value + 1e-4 * (1 + abs(value))}))) is None
    assert printed_at(replace(point, states=point.states._replace(**{name: value * (1 + 1e-14)}))) is not None


def test_a_planted_error_changes_the_tone_of_its_entry_and_of_no_other() -> None:
    published = published_models()[0]
    model = regenerate(Aircraft(), published)
    tables = matrices_beside_the_print(model, published)
    tones = {tone_of(cell) for table in tables for row in table.rows for cell in row[1:]}
    assert tones == {"", "good", "near"}  # the worst is off by 1.21 half units
    for half_units, tone in ((0.9, "good"), (1.9, "near"), (-2.9, "far"), (3.1, "bad")):
        A = model.A.copy()
        A[3, 1] = published.A[3, 1] + half_units * published.half_unit_A[3, 1]
        (planted, _) = matrices_beside_the_print(replace(model, A=A), published)
        assert (planted.rows[6][0], planted.rows[7][0]) == ("pitch_rate", "printed")
        assert tone_of(planted.rows[6][2]) == tone
        others = [tone_of(cell) for i, row in enumerate(planted.rows) for cell in row[1:] if i != 6]
        assert others == [tone_of(cell) for i, row in enumerate(tables[0].rows) for cell in row[1:] if i != 6]


def tone_of(cell: str) -> str:
    return getattr(cell, "tone", "")


def test_the_table_of_entries_leaves_out_what_is_zero_in_both_and_nothing_else() -> None:
    off, zero = EntryRow("A", "speed", "alpha", -2.0, -2.0001, 5e-5), EntryRow("A", "speed", "dihedral", 0.0, 0.0, 5e-5)
    small = EntryRow("B", "alpha", "throttle", 0.0, -2.6e-5, 5e-5)
    table = entries_table("at 15 deg", {"first ": [off, zero, small]})
    assert [tuple(each) for each in table.rows] == [
        ("first A(speed, alpha)", "-2.0000", "-2.000100", "-2.00", "-0.0050"),
        ("first B(alpha, throttle)", "0.0000", "-0.000026", "-0.52", "-"),
    ]
    records = entries_records({15.0: [off, zero]})
    assert [each[:2] for each in records.rows] == [(15.0, "A(speed, alpha)"), (15.0, "A(speed, dihedral)")]
