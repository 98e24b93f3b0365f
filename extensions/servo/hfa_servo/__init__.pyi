"""Subjects of the design of a controller: the aircraft with actuators, integrals of outputs and
weights."""

from .controllers import design_controller as design_controller
from .design import load_design as load_design
