"""Calls of notebooks: responses of linear models, and words of other tools."""
