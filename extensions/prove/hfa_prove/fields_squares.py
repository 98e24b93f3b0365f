"""Entries of a statement about a region.

Each entry is a claim, or is compared with the user's data.
"""

from __future__ import annotations

from hfa_prove.fields import Field, FieldTable

_AIRCRAFT = Field("aircraft")
FIELDS: FieldTable = {
    "dynamics": _AIRCRAFT,
    "source": _AIRCRAFT,
    "states": _AIRCRAFT,
    "state_units": _AIRCRAFT,
    "input_units": _AIRCRAFT,
    "disturbance_units": _AIRCRAFT,
    "parameters": Field("parameters"),
    "trim": Field("trim"),
    "inputs": Field("trim"),
    "held": Field("trim"),
    "limits": Field("limits"),
    "K": Field("policy"),
    "policy": Field("policy"),
    "disturbances": Field(),
    "terms": Field(),
    "rho": Field(),
    # Proved; the printed extents are computed by the checker.
    "extents": Field(shown=False),
}
