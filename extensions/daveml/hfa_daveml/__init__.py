"""Flight-dynamics models in DAVE-ML, the exchange format of ANSI/AIAA S-119.

- `document.py` reads a file.
- `mathml.py` and `functions.py` convert formulas and tables to CasADi expressions.
- `check_cases.py` recomputes the check cases of a file.
- `read.py` makes a `Model` of files with aerodynamics, mass properties and propulsion.
"""

from hfa_daveml.check_cases import checked_outputs, model_unit, value_of
from hfa_daveml.document import read_document
from hfa_daveml.read import read_model

__all__ = ["checked_outputs", "model_unit", "read_document", "read_model", "value_of"]
