"""Convenience calls for notebooks: responses of linear models, and names used by other tools."""
