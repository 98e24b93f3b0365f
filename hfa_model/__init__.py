"""The aircraft: three rigid panels on two hinges, seven states, five inputs, written symbolically."""

from typing import TYPE_CHECKING

from hfa_model.support.door import open_door

if TYPE_CHECKING:
    from hfa_model.aerodynamics import aircraft_loads as aircraft_loads
    from hfa_model.aircraft import Aircraft as Aircraft
    from hfa_model.atmosphere import density as density
    from hfa_model.dynamics import rates_from_loads as rates_from_loads
    from hfa_model.parameters import (
        Parameters as Parameters,
        ParameterSet as ParameterSet,
        default_parameters as default_parameters,
        load_parameters as load_parameters,
        named_parameters as named_parameters,
        sample_parameters as sample_parameters,
        save_parameters as save_parameters,
    )
    from hfa_model.published import PublishedModel as PublishedModel, published_models as published_models
    from hfa_model.reporting.checks import Check as Check
    from hfa_model.reporting.report import Report as Report
    from hfa_model.reporting.unit_system import shown_in as shown_in
    from hfa_model.support.errors import BadInputError as BadInputError, NoSolutionError as NoSolutionError
    from hfa_model.variants import VARIANTS as VARIANTS, Newton as Newton, Published as Published
    from hfa_model.vectors import (
        DEGREE as DEGREE,
        INPUT_UNITS as INPUT_UNITS,
        INPUTS as INPUTS,
        LINEAR_STATES as LINEAR_STATES,
        STATE_UNITS as STATE_UNITS,
        STATES as STATES,
        Input as Input,
        State as State,
    )
    from hfa_model.winds import Wind as Wind, Winds as Winds

__getattr__, __dir__, __all__ = open_door(__name__)
