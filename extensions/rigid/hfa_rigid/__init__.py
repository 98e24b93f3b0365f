"""Rigid aircraft in standard air over a flat Earth, for readers of aircraft.

`motion.py` holds the equations of motion, `atmosphere.py` the air, `tables.py` interpolates, and
`aircraft.py` makes the `Model` of forces, moments and masses."""
