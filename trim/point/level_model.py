"""Linear model at the trim that a model declares, in one call."""

from __future__ import annotations

from hfa_aircraft.model import Model
from hfa_support.arguments import checks_arguments, need
from trim.linear.linear_model import LinearModel
from trim.point.condition import usual_condition
from trim.point.solve import trim


@checks_arguments
def level_model(model: Model, scheduled: float) -> LinearModel:
    """Return the linear model of an aircraft at the trim that its model declares.

    For the flexible aircraft, this trim is the paper's level flight.

    model: model of the aircraft
    scheduled: value of the scheduling variable; for the flexible aircraft the dihedral angle, rad

    Raises TrimError if the trim does not exist.

    >>> import hfa
    >>> hfa.paper.level_model(hfa.aircraft(), 0.2).states
    ('speed', 'alpha', 'pitch', 'pitch_rate', 'dihedral', 'dihedral_rate')
    """
    need(model, Model, "level_model: model", Model.how_to_make)
    condition = usual_condition(model).at(hold={model.schedule: scheduled})
    return trim(model, condition).linearize()
