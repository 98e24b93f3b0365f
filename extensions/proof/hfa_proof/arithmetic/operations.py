"""Names of the operations in CasADi functions."""

from __future__ import annotations

import casadi as ca


def operation_name(code: int) -> str:
    """Return the lower-case name of a CasADi operation code, or the code if it has no name."""
    for name in dir(ca):
        if name.startswith("OP_") and getattr(ca, name) == code:
            return name.removeprefix("OP_").lower()
    return str(code)
