"""Subjects of the design of a controller: the aircraft with actuators, integrals of outputs and
weights."""

from .controllers import design_controller as design_controller
from .design import load_design as load_design
from .generalized_plant import GeneralizedPlant as GeneralizedPlant, solve_plant as solve_plant
from .scheduled_controller import (
    ScheduledController as ScheduledController,
    load_controller as load_controller,
    save_controller as save_controller,
)
