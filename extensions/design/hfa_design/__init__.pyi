"""Design of a controller."""

from hfa_flight.actuators import Actuator as Actuator

from .controllers import (
    LinearController as LinearController,
    controller_at as controller_at,
    design_controller as design_controller,
)
from .design import (
    Design as Design,
    Following as Following,
    OutputWeight as OutputWeight,
    load_design as load_design,
)
from .design_models import DesignModel as DesignModel, design_model as design_model
from .loop_shaping import robust_check as robust_check, robust_controller as robust_controller
from .plant.generalized_plant import (
    GeneralizedPlant as GeneralizedPlant,
    closed_plant as closed_plant,
    solve_plant as solve_plant,
)
from .plant.plant_report import solution_of_plant as solution_of_plant
from .servo_loops import (
    ServoLoop as ServoLoop,
    check_margins as check_margins,
    servo_loop as servo_loop,
    servo_margins as servo_margins,
    servo_plant as servo_plant,
)
