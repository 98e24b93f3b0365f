"""A and B on the page compared with the printed matrices."""

from __future__ import annotations

from dataclasses import replace

import hfa
from hfa import LinearModel
from hfa.page.compared_with_print import printed_comparison_tables
from hfa_model.published import published_models
from trim import regenerate


def test_a_planted_deviation_colors_only_its_entry() -> None:
    """A planted deviation of an entry changes the color of this entry by size, and no other color."""
    published = published_models()[0]
    model = regenerate(hfa.aircraft(), published)

    def tones(model: LinearModel) -> list[list[str]]:
        rows = [row for table in printed_comparison_tables(model, published) for row in table.rows]
        assert (rows[6][0], rows[7][0]) == ("pitch_rate", "printed")
        return [[getattr(cell, "tone", "") for cell in row[1:]] for row in rows]

    expected = tones(model)
    assert {tone for row in expected for tone in row} == {
        "",
        "good",
        "near",
    }  # the largest deviation is 1.21 half units
    for half_units, tone in ((0.9, "good"), (1.9, "near"), (-2.9, "far"), (3.1, "bad")):
        A = model.A.copy()
        A[3, 1] = published.A[3, 1] + half_units * published.half_unit_A[3, 1]
        expected[6][1] = tone
        assert tones(replace(model, A=A)) == expected
