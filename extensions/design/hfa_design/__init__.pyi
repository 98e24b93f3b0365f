"""Design of a controller."""

from .controllers import design_controller as design_controller
from .design import load_design as load_design
from .plant.generalized_plant import (
    GeneralizedPlant as GeneralizedPlant,
    solve_plant as solve_plant,
)
