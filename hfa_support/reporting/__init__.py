"""Reports of results: numbers as text, units, checks, tables, pictures and files."""
