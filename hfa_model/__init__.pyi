"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written symbolically."""

from .aerodynamics import aircraft_loads as aircraft_loads
from .aircraft import Aircraft as Aircraft
from .atmosphere import density as density
from .dynamics import rates_from_loads as rates_from_loads
from .parameters import (
    Parameters as Parameters,
    default_parameters as default_parameters,
    load_parameters as load_parameters,
    named_parameters as named_parameters,
    sample_parameters as sample_parameters,
    save_parameters as save_parameters,
)
from .printed_matrices import published_models as published_models
from .unsteady import UNSTEADY as UNSTEADY, unsteady_model as unsteady_model
from .variants import VARIANTS as VARIANTS, Published as Published
from .vectors import (
    DEGREE as DEGREE,
    INPUTS as INPUTS,
    LINEAR_STATES as LINEAR_STATES,
    STATES as STATES,
    Input as Input,
    State as State,
)
from .winds import Wind as Wind, Winds as Winds
