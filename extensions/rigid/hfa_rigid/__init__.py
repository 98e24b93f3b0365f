"""Rigid aircraft in standard air over a flat Earth, for readers of aircraft.

`motion.py` contains the equations of motion and `atmosphere.py` the air. `tables.py` interpolates.
`aircraft.py` makes the `Model` of forces, moments and masses.
"""
