"""Level flight of the paper, and the other named trim conditions of the paper's aircraft."""

from __future__ import annotations

from collections.abc import Mapping
from functools import cache
from pathlib import Path

from trim.point.condition import TrimCondition, usual_condition

#: Named condition -> its file.
CONDITIONS = {
    name: Path(__file__).with_name(f"{name.replace('-', '_')}.toml")
    for name in ("paper", "simvfa-64", "simvfa-30")
}


@cache
def _flat_wing() -> TrimCondition:
    """Return the paper's level flight (Section 5.1), with a flat wing."""
    from hfa_model.choice import aircraft

    return usual_condition(aircraft())


def level_flight(
    dihedral: float, *, limits: Mapping[str, tuple[float, float]] | None = None, **held: float
) -> TrimCondition:
    """Return the paper's trim condition at a dihedral angle.

    By default the center aileron is 0, and throttle, outer aileron and both elevators are free.

    dihedral: rad
    limits: variable -> (lowest, highest), instead of the model's limits; None for the model's
        limits
    held: variable -> imposed value, instead of the paper's; in rad, ft, s

    >>> import hfa
    >>> hfa.paper.level_flight(0.2, speed=70.0).free
    ('throttle', 'aileron_outer', 'elevator_center', 'elevator_outer')
    """
    model = _flat_wing().model
    imposed = {**model.trim, model.schedule: dihedral, **held}
    return TrimCondition(model, imposed, limits=dict(limits or {}))


def load_condition(name: str, usual: TrimCondition | None = None) -> TrimCondition:
    """Return a trim condition by its name in `CONDITIONS`, or from a user's file.

    name: name of the condition, or path of the file
    usual: condition to which the file is applied as changes; default: the paper's

    Raises BadInputError, which names the file and the fault, if the file is not a valid condition.
    """
    from trim.point.condition import read_condition

    return read_condition(name, usual or _flat_wing(), CONDITIONS)
