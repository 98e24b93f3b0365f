"""Flight-dynamics models of DAVE-ML, the exchange format of ANSI/AIAA S-119.

`document.py` reads a file, `mathml.py` and `functions.py` turn its formulas and tables into CasADi
expressions, `check_cases.py` computes the check cases of a file, and `aircraft.py` makes
a `Model` of files with aerodynamics, mass properties and propulsion."""
