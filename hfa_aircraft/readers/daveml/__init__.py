"""Flight-dynamics models in DAVE-ML, the exchange format of ANSI/AIAA S-119.

- `document.py` reads a file.
- `mathml.py` and `functions.py` convert formulas and tables to CasADi expressions.
- `check_cases.py` computes the check cases of a file.
- `read.py` makes a `Model` of files with aerodynamics, mass properties and propulsion.
"""
