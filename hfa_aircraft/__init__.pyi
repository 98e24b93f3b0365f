"""Declaration, loading and conversion of aircraft models."""

from .control_systems import to_control as to_control
from .units import in_si as in_si
