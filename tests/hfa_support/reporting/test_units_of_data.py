"""Numbers of a report in SI, by their declared units: lists of units, names of quantities, a unit in brackets."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from hfa_model.aircraft import HFA
from hfa_support import Model, Report, Signal, shown_in
from hfa_support.reporting.text import Table
from hfa_support.reporting.units_of_data import in_si as converted

FT, LBF = 0.3048, 4.4482216152605


def in_si(data: dict[str, Any], records: Table | None = None) -> Report:
    with shown_in("si"):
        return converted(Report("", (), data=data, records=records or Table((), [])), HFA)


@pytest.mark.parametrize(
    ("name", "value", "expected"),
    [
        ("output_offsets", [2.0, 3.0], [2.0 * FT, 3.0]),
        ("C", [[2.0, 3.0], [4.0, 5.0]], [[2.0, 3.0 * FT], [4.0 / FT, 5.0]]),
        ("P", [[2.0, 3.0], [4.0, 5.0]], [[2.0 / FT**2, 3.0 / FT], [4.0 / FT, 5.0]]),
        ("K", [[2.0, 3.0]], [[2.0 * LBF / FT, 3.0 * LBF]]),
    ],
)
def test_arrays_by_the_lists_of_units_beside_them(name: str, value: Any, expected: Any) -> None:
    beside = {"state_units": ["ft/s", "rad"], "input_units": ["lbf"], "output_units": ["ft/s", "rad"]}
    found = in_si({**beside, name: value}).data
    np.testing.assert_allclose(found[name], expected, rtol=1e-12)
    assert found["state_units"] == ["m/s", "rad"]


def test_arrays_and_names_of_another_model_have_its_units() -> None:
    model = Model(
        "cart",
        {"place": Signal("m"), "speed": Signal("ft/s")},
        {"force": Signal("lbf")},
        lambda x, u, p, w: ({"place": x.speed, "speed": u.force}, {}),
    )
    data = {"operating_states": [[2.0, 3.0]], "operating_inputs": [[4.0]], "residuals": {"place": 5.0, "speed": 6.0}}
    with shown_in("si"):
        found = converted(Report("", (), data=data), model).data
    np.testing.assert_allclose(found["operating_states"], [[2.0, 3.0 * FT]])
    np.testing.assert_allclose(found["operating_inputs"], [[4.0 * LBF]])
    assert found["residuals"] == {"place": 5.0, "speed": pytest.approx(6.0 * FT)}
