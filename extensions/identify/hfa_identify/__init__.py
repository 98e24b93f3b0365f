"""Parameters of a model from flight records, by output error with maximum likelihood.

`records.py` reads records, `response.py` simulates the model with exact sensitivities, `fit.py`
finds the parameters, `bands.py` says how well a record determines them, `identified.py` is the
result."""
