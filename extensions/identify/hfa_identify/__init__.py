"""Identification of model parameters from flight records: output error, maximum likelihood.

`records.py` reads records. `response.py` simulates the model with exact sensitivities. `fit.py`
finds the parameters. `bands.py` computes their confidence bands. `residuals.py` tests the
residuals. `identified.py` is the result.
"""

from hfa_support.public_names import public_names

__getattr__, __dir__ = public_names(__name__, __file__)
