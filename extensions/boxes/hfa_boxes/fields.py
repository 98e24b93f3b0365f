"""The fields of a statement about a region on boxes, and what becomes of each."""

from __future__ import annotations

from hfa_proof.subject import Field, FieldTable

_AIRCRAFT = Field("aircraft")
FIELDS: FieldTable = {
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
    "policy": Field("policy"),
    "equilibrium": Field(),
    "P": Field(),
    "rho": Field(),
    "extents": Field(),
}
