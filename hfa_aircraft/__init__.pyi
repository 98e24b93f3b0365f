"""Declaration, loading and conversion of aircraft models."""

from .units import in_si as in_si
