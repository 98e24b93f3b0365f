"""Identification of model parameters from flight records: output error, maximum likelihood.

`records.py` reads records. `response.py` simulates the model with exact sensitivities. `fit.py`
finds the parameters. `bands.py` computes their confidence bands. `identified.py` is the result.
"""
