"""Flight-dynamics models of DAVE-ML, the exchange format of ANSI/AIAA S-119.

`document.py` reads a file, `mathml.py` and `functions.py` turn its formulas and tables into CasADi
expressions, `check_cases.py` computes the cases that a file brings with it, and `aircraft.py` makes
a `Model` of files with aerodynamics, mass properties and propulsion."""
