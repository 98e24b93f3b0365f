"""The common parts of all packages: errors, files, reports, jobs and native code."""
