"""What an exported loop calls its states."""

from __future__ import annotations

from types import SimpleNamespace

from controller.export.exported_loop import _actuator_states
from hfa_model import INPUT_UNITS, INPUTS


def test_actuators_have_the_units_of_their_inputs_and_their_rates_none() -> None:
    found = _actuator_states(SimpleNamespace(order=2))  # type: ignore[arg-type]
    assert [each.name for each in found[:5]] == [f"{name}_actuator" for name in INPUTS]
    assert [each.unit for each in found] == [*INPUT_UNITS, *[None] * 5]
