"""Design of a controller."""

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
from .design_model import DesignModel as DesignModel
from .plant.generalized_plant import (
    GeneralizedPlant as GeneralizedPlant,
    closed_plant as closed_plant,
    solve_plant as solve_plant,
)
from .servo_loop import (
    ServoLoop as ServoLoop,
    check_margins as check_margins,
    servo_margins as servo_margins,
    servo_plant as servo_plant,
)
