"""Presentation of results: numbers as text, units, checks, tables, pictures, files."""
