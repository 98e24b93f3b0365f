"""Detection of records without motion, and of parameters that the records cannot determine.

A parameter cannot be determined if it multiplies a state or an input that did not move.
"""

from __future__ import annotations

from collections.abc import Iterable

import casadi as ca
import numpy as np

from hfa_aircraft.layout import components
from hfa_identify.bands import WHITE, explained, whiteness
from hfa_identify.fit import Fit
from hfa_identify.records import Record, columns_of
from hfa_identify.response import Responses
from hfa_identify.search import Search
from hfa_support.errors import NoSolutionError

#: A quantity moves if its range is at least this fraction of its nominal value.
_MOVES = 0.02
#: A fit explains a quantity if the coefficient of determination is larger.
_EXPLAINED = 0.5


def refuse_still(search: Search, fit: Fit | None) -> None:
    """Raise NoSolutionError if the fit explains no measured quantity and the records lack motion.

    Records lack motion if all inputs are constant, or if each measured quantity is white noise
    about a constant.

    fit: None if the simulation diverges
    """
    if fit is not None and (explained(fit) > _EXPLAINED).any():
        return
    if search.moving_inputs() and not all(map(_is_noise, search.records)):
        return
    names = ", ".join(record.name for record in search.records)
    raise NoSolutionError(
        f"{names}: the model explains none of the recorded motion; record a maneuver"
    )


def _is_noise(record: Record) -> bool:
    """Return True if every measured quantity of a record is white noise about a constant."""
    for values in record.measured.values():
        present = np.isfinite(values)
        if whiteness(values - values[present].mean(), present) < WHITE:
            return False
    return True


def still_quantities(search: Search, parameters: Iterable[str]) -> dict[str, str]:
    """Return parameter -> the motionless state or input that it multiplies, "" if none exists.

    parameters: parameters that the records do not determine
    """
    return {name: _still(search, name) for name in parameters}


def _still(search: Search, name: str) -> str:
    """Return the motionless state or input on which a parameter's effect depends most, or ""."""
    # The dependence is ∂²f/∂θ∂(x, u), relative to nominal values, at the first sample of the first
    # record. The result is "" if the state or input moved in a record, or if the derivative is 0.
    model = search.responses.model
    x, u, p = model.layout.symbols("x", "u", "p")
    vectors = [components(x), components(u), components(p)]
    rates, _ = model.layout.expressions(vectors, ())
    effect = ca.jacobian(rates, p[list(model.parameters).index(name)])
    mixed = ca.densify(ca.jacobian(effect, ca.vertcat(x, u)))
    slopes = ca.Function("mixed", [x, u, p], [mixed])
    record, start = search.records[0], search.guesses[0]
    sizes = [model.signals[each].nominal for each in (*model.states, *model.inputs)]
    rows = [each.rate or each.nominal for each in model.states.values()]
    values = np.abs(slopes(start, record.inputs[0], model.p).full()) * sizes
    strongest = int((values / np.array(rows)[:, None]).max(axis=0).argmax())
    quantity = [*model.states, *model.inputs][strongest]
    return quantity if values.any() and not _moves(search, quantity, sizes[strongest]) else ""


def _moves(search: Search, quantity: str, size: float) -> bool:
    """Return whether a state or input moved in any record."""
    # A state without a sensor is simulated with the initial parameters of the search. If this
    # simulation diverges, the state counts as moved.
    model = search.responses.model
    for record, start in zip(search.records, search.guesses, strict=True):
        columns = columns_of(model, record)
        if quantity in columns:
            values = columns[quantity]
        else:
            simulated = Responses(model, search.responses.free, (quantity,))
            try:
                values = simulated.of(record, start, search.begin).y[:, 0]
            except FloatingPointError:
                return True
        if np.nanmax(values) - np.nanmin(values) > _MOVES * size:
            return True
    return False
