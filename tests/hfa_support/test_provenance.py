"""Provenance of outputs: changed parameters, hash and date."""

from __future__ import annotations

import json
import math
from dataclasses import replace

from hfa_model.parameters import ParameterSet, changed_parameters
from hfa_support.provenance import Change, Provenance, parameter_hash


def test_provenance_contains_changed_parameters(parameter_set: ParameterSet) -> None:
    """The provenance contains each changed parameter, in text and in JSON."""
    edited = replace(parameter_set, values=parameter_set.values._replace(panel_mass=10.5))
    assert changed_parameters(edited) == {
        "panel_mass": Change(10.5, parameter_set.values.panel_mass, "slug")
    }
    block = Provenance("hfa trim", "published", "heavy.toml", "0" * 12, changed_parameters(edited))
    assert "panel_mass 10.5 slug (identified: 9.32593)" in block.text()
    assert json.loads(json.dumps(block.to_dict()))["changed"]["panel_mass"]["value"] == 10.5


def test_the_smallest_change_changes_the_hash(parameter_set: ParameterSet) -> None:
    """A change of one bit of one parameter changes the hash."""
    values = parameter_set.values
    nudged = values._replace(gravity=math.nextafter(values.gravity, 33.0))
    assert parameter_hash(nudged) != parameter_hash(values)
