"""The user's data in the form of a statement, for comparison with a certificate."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from hfa.options.argument_types import array_of
from hfa.options.games import given_weights
from hfa.options.parser import is_given
from hfa.options.trims import OF_THE_TRIM, GivenTrim, trim_input
from hfa_aircraft.model import Model
from hfa_prove.commands.check_request import CheckRequest
from hfa_prove.commands.schedule import gains_of_file, interval_of, refuse_weights
from hfa_prove.fields import Given, close_to, within
from hfa_prove.search.schedule import Family, exact_gains
from hfa_prove.statements.schedule import SAME_TRIM, ScheduleStatement
from trim.point.status import BALANCE

#: Options that name an aircraft or its trim.
_OF_THE_AIRCRAFT = ("aircraft", "dynamics", "parameters", "servo", *OF_THE_TRIM)
#: Options that define the game of the gains.
_OF_THE_GAME = ("N", "delta", "Q", "R", "sizes")
#: Largest difference of two gains that are called equal, in nominal values, relative to the largest
#: entry. A gain is proved for its linear model, but not the trim, whose residuals are at most
#: `BALANCE`: on the flexible aircraft they change the gain by at most 0.6 times as much, at the
#: dihedral 15 deg. The factor 10 is a margin for other weights, not derived.
SAME_GAIN = 10.0 * BALANCE


class AskedTrim(NamedTuple):
    """The trims that a certificate must be about.

    given: the trim, without the value of the scheduling variable
    ends: value or ends of the scheduling variable, as typed, or ()
    """

    given: GivenTrim
    ends: tuple[float, ...]


def asked_trim(request: CheckRequest) -> AskedTrim:
    """Return the trims that the options define."""
    asked = trim_input(request, scheduled=interval_of)
    ends = () if asked.at is None else tuple(array_of("--at", asked.at, 2).tolist())
    return AskedTrim(asked.trim(at=None, hold=asked.held()), ends)


def _is_any_given(request: CheckRequest, names: tuple[str, ...]) -> bool:
    """Return whether one of these options is given."""
    return any(is_given(request, name) for name in names)


def given_for(
    statement: ScheduleStatement, request: CheckRequest, trim: AskedTrim
) -> dict[str, Given]:
    """Return path of an entry of the statement -> the value that the user's options give.

    Raises BadInputError or NoSolutionError if the options do not define the subject.
    """
    flight = statement.flight
    given = {}
    if trim.ends:
        given["flight.range"] = Given([trim.ends[0], trim.ends[-1]])
    family = Family(trim.given.model, trim.given.common)
    if _is_any_given(request, _OF_THE_AIRCRAFT):
        # The user's trims on the interval of the certificate, in the form of its entries.
        content = family.flight(flight.low, flight.high).content()
        for name in ("model", "parameters", "imposed", "limits"):
            given[f"flight.{name}"] = Given(content[name])
        widths = {name: SAME_TRIM * flight.model.signals[name].nominal for name in flight.unknowns}
        given["flight.first"] = Given(content["first"], same=within(widths))
    if request.weights is not None:
        refuse_weights(request)
        gains = gains_of_file(request.weights, trim.given.model)
        K = Given(gains.K)
    elif _is_any_given(request, _OF_THE_GAME):
        weights = given_weights(request, family.model)
        gains = exact_gains(family, statement.gains.breakpoints, **weights)
        K = Given(gains.K, close_to(SAME_GAIN, sizes_of_gain(trim.given.model)))
    else:
        return given
    given["gains.breakpoints"] = Given(gains.breakpoints)
    given["gains.K"] = K
    return given


def sizes_of_gain(model: Model) -> np.ndarray:
    """Return the typical sizes (m, n) of the entries of a gain, which depend on units as K does."""
    return np.outer(model.nominal(model.inputs), 1.0 / model.nominal(model.linear))
