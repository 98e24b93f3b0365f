"""Errors, files, reports, progress and compiled functions, used by all packages."""
