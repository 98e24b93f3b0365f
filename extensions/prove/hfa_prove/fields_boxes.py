"""Entries of the statements that are proved on boxes.

Each entry is a claim, or is compared with the user's data.
"""

from __future__ import annotations

from hfa_prove.fields import Field, FieldTable

_AIRCRAFT = Field("aircraft")
_PLANT: FieldTable = {
    "dynamics": _AIRCRAFT,
    "source": _AIRCRAFT,
    "states": _AIRCRAFT,
    "state_units": _AIRCRAFT,
    "input_units": _AIRCRAFT,
    "parameters": Field("parameters"),
    "trim": Field("trim"),
    "inputs": Field("trim"),
    "held": Field("trim"),
    "limits": Field("limits"),
}
FIELDS: FieldTable = {
    **_PLANT,
    "policy": Field("policy"),
    "equilibrium": Field(),
    "piece": Field(),
    "extents": Field(),
}
COST_FIELDS: FieldTable = {
    **_PLANT,
    "Q": Field("weights"),
    "R": Field("weights"),
    "equilibrium": Field(),
    "pieces": Field(),
}
