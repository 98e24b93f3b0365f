"""Rigid aircraft in standard air over a flat Earth, used by readers of aircraft files.

- `motion.py` contains the equations of motion.
- `atmosphere.py` contains the standard atmosphere.
- `tables.py` interpolates in tables.
- `aircraft.py` creates the `Model` from forces, moments and masses.
"""
