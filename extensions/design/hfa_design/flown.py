"""Controllers from files in `hfa fly` and `hfa export` (the command part "controllers")."""

from controller.schedule.scheduled_controller import (
    load_controller as load_controller,
    load_controller_or_gains as load_controller_or_gains,
)
from hfa_flight.export.controller_c import (
    c_controller_texts as c_controller_texts,
    controller_steering as controller_steering,
)
from hfa_flight.policies.controller import servo_policy as servo_policy
