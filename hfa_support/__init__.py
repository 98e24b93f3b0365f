"""Errors, files, reports, progress and native code, used by all packages."""
