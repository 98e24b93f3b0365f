"""Sheets of trims and reports of linear models."""
