"""Aircraft from functional mock-up units (FMI 2.0 and 3.0, model exchange).

An FMU is a compiled program: it is executed when it is read.
"""

from hfa_fmu.read import read_model

__all__ = ["read_model"]
