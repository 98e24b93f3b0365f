"""How results are shown: numbers as text, units, checks, tables, pictures, files of numbers."""
