"""Aircraft from a table of stability derivatives: six degrees of freedom, trimmed and linearized.

`names.py` lists the entries of a table, `table.py` reads them and their units, `aircraft.py` makes
the `Model`."""
