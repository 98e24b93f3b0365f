"""What all packages share: errors, files, reports, jobs and native code."""

from .errors import BadInputError as BadInputError, NoSolutionError as NoSolutionError
from .reporting.checks import Check as Check
from .reporting.report import Report as Report

# For one version: users' files imported these from here.
from hfa_aircraft import Model as Model, Signal as Signal  # isort: skip
