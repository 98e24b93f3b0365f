"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written
symbolically."""

from .choice import loads as loads
from .declaration import (
    is_hfa as is_hfa,
    parameters_of as parameters_of,
    variant_of as variant_of,
)
from .parameters import (
    DEGREE as DEGREE,
    INPUTS as INPUTS,
    LINEAR_STATES as LINEAR_STATES,
    STATES as STATES,
    Input as Input,
    Parameters as Parameters,
    State as State,
    load_parameters as load_parameters,
    sample_parameters as sample_parameters,
    save_parameters as save_parameters,
)
from .published import published_models as published_models
from .unsteady import UNSTEADY as UNSTEADY
from .variants import VARIANTS as VARIANTS
