"""Identification of model parameters from flight records."""

from .identified import Identified as Identified
from .records import Record as Record, read_record as read_record
