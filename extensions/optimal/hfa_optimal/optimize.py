"""Search for the cheapest or the quickest flight to a trim."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, overload

from hfa_aircraft.model import Model
from hfa_flight.problem import flight_problem
from hfa_optimal.best_flight import BestFlight
from hfa_optimal.quickest import QuickestFlight, quickest_to
from hfa_optimal.search import BestFlights
from hfa_support.arguments import ArrayLike, checks_arguments, need
from hfa_support.errors import BadInputError, shown
from trim.point.operating_point import OperatingPoint


@overload
def optimize(
    model: Model,
    point: OperatingPoint,
    initial: Mapping[str, float] | OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    minimize: Literal["cost"] = "cost",
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, Any] | None = None,
) -> BestFlight: ...
@overload
def optimize(
    model: Model,
    point: OperatingPoint,
    initial: Mapping[str, float] | OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    minimize: Literal["time"],
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, Any] | None = None,
) -> QuickestFlight: ...
@checks_arguments
def optimize(
    model: Model,
    point: OperatingPoint,
    initial: Mapping[str, float] | OperatingPoint,
    Q: ArrayLike | Mapping[str, float] | None = None,
    R: ArrayLike | Mapping[str, float] | None = None,
    *,
    minimize: Literal["cost", "time"] = "cost",
    inputs: Sequence[str] | None = None,
    limits: Mapping[str, Any] | None = None,
) -> BestFlight | QuickestFlight:
    """Return the cheapest or the quickest flight found from an initial condition to a trim.

    The cost is ∫ z'Qz + v'Rv dt, where z and v are the deviations from the trim. Collocation
    proposes the flight. The proposal is accepted if a simulation confirms it. Otherwise the result
    is the cheapest simulated flight, with the reason in `BestFlight.reason`.

    model: the aircraft
    point: trim at which the flight ends
    initial: state of the linear model -> deviation from the trim, in the units of the model, or
        another trim
    Q, R: weights, as `hfa.game` accepts them and with its defaults. R is the weight of the
        moving inputs.
    minimize: "cost", or "time" to the trim. For the time, Q and R weight the linear policy that
        follows the proposal.
    inputs: inputs that move, by default all. The others are constant.
    limits: state -> (lowest, highest), absolute, replacing the limits of the flight envelope

    Raises BadInputError for unknown names and an initial condition outside the limits. Raises
    NoSolutionError if no simulated flight within the limits converges, or if no quickest flight was
    found.

    >>> import hfa
    >>> cart = hfa.Model(
    ...     "cart",
    ...     {"position": hfa.Signal("m"), "velocity": hfa.Signal("m/s")},
    ...     {"force": hfa.Signal("N", min=-1.0, max=1.0)},
    ...     lambda x, u, p, w: ({"position": x.velocity, "velocity": u.force}, {}),
    ...     trim={"position": 0.0},
    ... )
    >>> point = hfa.trim(cart)
    >>> round(hfa.optimize(cart, point, {"position": 0.1}).cost, 4)  # sqrt(3) position²
    0.0173
    >>> round(hfa.optimize(cart, point, {"position": 4.0}, minimize="time").seconds, 1)  # 2 sqrt(4)
    4.0
    """
    need(model, Model, "optimize: model", Model._how_to_make)
    need(point, OperatingPoint, "optimize: point", "a trim: hfa.trim(model)")
    starts = (Mapping, OperatingPoint)
    need(initial, starts, "optimize: initial", "deviations {state: value}, or a trim")
    if minimize not in ("cost", "time"):
        raise BadInputError(f"minimize is {shown(minimize)}; give 'cost' or 'time'")
    problem = flight_problem(model, point, Q, R, inputs, limits)
    if minimize == "time":
        return quickest_to(problem, initial)
    return BestFlight(problem, BestFlights(problem).found(problem.deviations(initial)))
