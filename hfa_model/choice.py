"""Construction of the paper's aircraft as a `Model` with the chosen dynamics."""

from __future__ import annotations

from hfa_aircraft.model import Model
from hfa_model.declaration import rigid_panels
from hfa_model.parameters import Parameters, default_parameters
from hfa_model.trim_loads import panel_groups
from hfa_model.variants import Variant, variant_named
from hfa_support.errors import BadInputError, is_finite, shown

#: Parameters that must not be negative. Inertias are not included: a fit to one printed angle does
#: not determine one of them, and it may be negative.
_SIZES = ("panel_mass", "panel_span", "chord")


def aircraft(dynamics: str | Variant = "published", parameters: Parameters | None = None) -> Model:
    """Return the highly flexible aircraft as a `Model`.

    dynamics: "published", "newton", "unsteady", or a `Variant`
    parameters: by default the identified ones

    Raises BadInputError for unknown dynamics, for a parameter that is not finite, and for a
    negative size.

    >>> import hfa
    >>> hfa.aircraft("newton").inputs["throttle"].max
    200.0
    """
    values = default_parameters().values if parameters is None else parameters
    _refuse_impossible(values)
    if not isinstance(dynamics, str):
        return rigid_panels(dynamics, values, panel_groups)
    if dynamics == "unsteady":
        from hfa_model.unsteady import unsteady_aircraft

        return unsteady_aircraft(values)
    return rigid_panels(variant_named(dynamics), values, panel_groups)


def _refuse_impossible(parameters: Parameters) -> None:
    """Raise BadInputError for a parameter that is not finite, and for a negative size."""
    for name, value in parameters._asdict().items():
        if not is_finite(value):
            raise BadInputError(f"parameter {name} is {shown(value)}; give a finite number")
        if name in _SIZES and value < 0.0:
            raise BadInputError(f"parameter {name} is {value:g}; give a number of at least 0")
