"""Calls for notebooks: responses of linear models, and calls under the names of other tools."""
