"""Parameters of a model from flight records, by output error with maximum likelihood.

`records.py` reads records, `response.py` simulates the model with exact sensitivities, `fit.py`
finds the parameters, `bands.py` computes their bands, `identified.py` is the result."""
