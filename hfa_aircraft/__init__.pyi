"""What an aircraft is to every package: the declaration of a model, how it is loaded and
converted."""

from .control_systems import from_control as from_control, to_control as to_control
