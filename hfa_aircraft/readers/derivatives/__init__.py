"""Six-degree-of-freedom aircraft from a table of stability derivatives.

- `names.py` lists the entries of a table.
- `table.py` reads the entries and their units.
- `read.py` creates the `Model`.
- `changed.py` reads a file that changes parameters of another aircraft.
"""
