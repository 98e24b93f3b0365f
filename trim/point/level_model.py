"""Linear model at a model's own trim, in one call."""

from __future__ import annotations

from hfa_aircraft.model import Model
from hfa_support.arguments import checks_arguments
from trim.linear.linear_model import LinearModel
from trim.point.condition import usual_condition
from trim.point.solve import find_operating_point


@checks_arguments
def level_model(model: Model, scheduled: float) -> LinearModel:
    """Return the linear model at the model's own trim; for the HFA it is the paper's level flight.

    model: the aircraft
    scheduled: value of its scheduling variable; for the HFA the dihedral angle, rad

    Raises TrimError when this trim does not exist.

    >>> import hfa
    >>> hfa.paper.level_model(hfa.aircraft(), 0.2).states
    ('speed', 'alpha', 'pitch', 'pitch_rate', 'dihedral', 'dihedral_rate')
    """
    condition = usual_condition(model).at(hold={model.schedule: scheduled})
    return find_operating_point(model, condition).linearize()
