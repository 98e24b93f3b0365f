"""How results are said: numbers as text, units, checks, tables, pictures, files of numbers."""
