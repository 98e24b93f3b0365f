"""Six-degree-of-freedom aircraft from a table of stability derivatives.

- `names.py` lists the entries of a table.
- `entries.py` reads the numbers of entries and their units.
- `avl.py` completes a table by a stability file of AVL.
- `dimensional.py` converts dimensional derivatives.
- `table.py` reads and checks a table.
- `read.py` creates the `Model`.
"""
