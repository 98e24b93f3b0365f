"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written
symbolically."""

from .declaration import (
    is_hfa as is_hfa,
    parameters_of as parameters_of,
    variant_of as variant_of,
)
from .parameters import (
    Parameters as Parameters,
    load_parameters as load_parameters,
    sample_parameters as sample_parameters,
    save_parameters as save_parameters,
)
from .published import published_models as published_models
from .trim_loads import loads as loads
from .unsteady import UNSTEADY as UNSTEADY
from .variants import VARIANTS as VARIANTS
from .vectors import (
    DEGREE as DEGREE,
    INPUTS as INPUTS,
    LINEAR_STATES as LINEAR_STATES,
    STATES as STATES,
    Input as Input,
    State as State,
)
