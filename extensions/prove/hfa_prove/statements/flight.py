"""Trims of an aircraft over an interval of its scheduling variable, read from a certificate.

Scheduling values are stored as a user types them, with angles in degrees, because their doubles are
then exact. All other numbers are in the units of the model.
"""

from __future__ import annotations

import math
from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any, NamedTuple

import numpy as np
from flint import arb

from hfa_aircraft.model import Model
from hfa_prove.enclosure.series import TaylorModel
from hfa_prove.fields import Fields, Stated, entry, require
from hfa_prove.statements.plant import facts, read_model


class StatedTrim(NamedTuple):
    """Approximate values of the unknowns of a trim at one scheduling value.

    The proved trim is the only trim within `SAME_TRIM` nominal values of each unknown.

    breakpoint: scheduling value
    unknowns: unknown -> approximate value
    """

    breakpoint: float
    unknowns: Mapping[str, float]


def _read_spread(file: Fields, name: str, known: Any) -> dict[str, float]:
    """Return parameter -> half-width. Raises Malformed unless every half-width is positive."""
    spread = file.numbers(name, known.model.parameters)
    require(all(width > 0.0 for width in spread.values()), "spread")
    require(known.model.schedule not in spread, "spread", known.model.schedule)
    return spread


def _read_limits(file: Fields, name: str, known: Any) -> dict[str, tuple[float, float]]:
    """Return signal -> (lowest, highest).

    Limits of disturbances, and of signals that have no limits in the model, may be omitted.

    Raises Malformed in these cases:
    - A limit is wider than the model's limit.
    - A signal with limits in the model has no limits in the certificate.
    """
    model = known.model
    stated = file.fields(name)
    limits = {}
    for signal, (least, most) in model.limits.items():
        needed = bool(np.isfinite((least, most)).any()) and signal not in model.disturbances
        if needed or stated.has(signal):
            low, high = stated.pair(signal)
            where = f"limits: {signal} beyond the model's"
            require(least <= low and high <= most, where, [low, high])
            limits[signal] = (low, high)
    stated.close()
    return limits


def _read_trims(file: Fields, name: str, known: Any) -> tuple[StatedTrim, ...]:
    """Return the stated trims, one for each branch.

    Raises Malformed unless their scheduling values ascend within the interval.
    """
    low, high = known.range
    trims = []
    for trim in file.items(name):
        breakpoint = trim.number("breakpoint")
        require(low <= breakpoint <= high, "trims", breakpoint)
        unknowns = trim.all_numbers("unknowns", unknowns_of(known.model, known.imposed))
        trim.close()
        trims.append(StatedTrim(breakpoint, unknowns))
    breakpoints = [trim.breakpoint for trim in trims]
    require(sorted(set(breakpoints)) == breakpoints, "trims", breakpoints)
    return tuple(trims)


def unknowns_of(model: Model, imposed: Mapping[str, float]) -> tuple[str, ...]:
    """Return the names of the unknowns of a trim."""
    return tuple(name for name in model.variables if name not in (model.schedule, *imposed))


@dataclass(frozen=True, eq=False)
class Flight(Stated):
    """Trims of an aircraft at every scheduling value of an interval, within its limits.

    model: the equations
    parameters: every parameter of the model -> value
    spread: parameter -> half-width of the values that the claim covers
    imposed: imposed variable -> value, the same for every trim
    limits: state, input or output -> (lowest, highest)
    range: lowest and highest scheduling value
    trims: one stated trim for each branch of trims that the claim covers, in ascending order
    """

    model: Model = entry(read_model, store=facts, subject="aircraft")
    parameters: Mapping[str, float] = entry(
        lambda file, name, known: file.all_numbers(name, tuple(known.model.parameters)),
        subject="parameters",
    )
    spread: Mapping[str, float] = entry(_read_spread)
    imposed: Mapping[str, float] = entry(
        lambda file, name, known: file.numbers(
            name, [each for each in known.model.holdable if each != known.model.schedule]
        ),
        subject="trim",
    )
    limits: Mapping[str, tuple[float, float]] = entry(_read_limits, subject="limits")
    range: tuple[float, float] = entry(lambda file, name, known: file.pair(name))
    trims: tuple[StatedTrim, ...] = entry(
        _read_trims, store=lambda trims: [{**trim._asdict()} for trim in trims], default=()
    )

    @property
    def low(self) -> float:
        """Lowest scheduling value."""
        return self.range[0]

    @property
    def high(self) -> float:
        """Highest scheduling value."""
        return self.range[1]

    @property
    def unknowns(self) -> tuple[str, ...]:
        """Names of the unknowns of a trim."""
        return unknowns_of(self.model, self.imposed)

    def value(self, scheduling_value: Any) -> Any:
        """Return a scheduling value in the unit of the model, as a ball or a double.

        An angle is converted from degrees to rad. For a ball, π is enclosed.
        """
        return in_model_unit(self.model, scheduling_value)

    def check_consistent(self) -> None:
        """Raise Malformed if no unknown is left, or an imposed or scheduling value is not within
        its limits.
        """
        require(bool(self.unknowns), "imposed", self.imposed)
        ends = {name: (value, value) for name, value in self.imposed.items()}
        ends[self.model.schedule] = (self.value(self.low), self.value(self.high))
        for name, (lowest, highest) in ends.items():
            if name in self.limits:
                least, most = self.limits[name]
                require(least <= lowest and highest <= most, f"{name} beyond its limits", lowest)


def in_model_unit(model: Model, scheduling_value: Any) -> Any:
    """Return a scheduling value of a certificate in the unit of the model.

    An angle is converted from degrees to rad.
    """
    if model.schedule_unit != "deg":
        return scheduling_value
    if isinstance(scheduling_value, arb):
        return scheduling_value * arb.pi() / 180
    return math.radians(scheduling_value)


@dataclass(frozen=True, eq=False)
class TrimBox:
    """Enclosure of the trims at all scheduling values from `low` to `high`.

    Each unknown differs from c0 + c1 s + c2 s² + Σ z_k t_k by at most its radius. t_k are the
    errors of the parameters in units of their half-widths, |t_k| <= 1.

    low, high: ends of the box of scheduling values
    polynomials: unknown -> c0 + c1 s + c2 s² + Σ z_k t_k
    radii: unknown -> radius
    """

    low: float
    high: float
    polynomials: dict[str, TaylorModel]
    radii: dict[str, arb]

    @classmethod
    def read(cls, entries: Fields, flight: Flight) -> TrimBox:
        """Return the enclosure stored in the entries `range` and `trim` of a certificate.

        Raises Malformed for the first wrong entry.
        """
        low, high = entries.pair("range")
        require(flight.low <= low < high <= flight.high, "range", [low, high])
        trims = entries.fields("trim")
        polynomials = {}
        radii = {}
        for name in flight.unknowns:
            radii[name], c0, c1, c2, *errors = trims.balls(name, 4 + len(flight.spread))
            polynomials[name] = TaylorModel(c0, c1, c2, arb(0), *errors)
            require(bool(radii[name] > 0), trims.where, name)
        trims.close()
        return cls(low, high, polynomials, radii)


@dataclass(frozen=True, eq=False)
class Line:
    """Matrix H that counts the eigenvalues of a matrix A on each side of the line Re λ = -rate.

    A has as many eigenvalues with Re λ > -rate as H has negative eigenvalues.

    H: symmetric matrix, (n, n)
    turn: coordinates in which the signs of the eigenvalues of H are decided, (n, n)
    rate: 1/s
    """

    H: np.ndarray
    turn: np.ndarray
    rate: float = 0.0

    @classmethod
    def read(cls, entries: Fields, n: int, *, rated: bool = True) -> Line:
        """Return the matrix H and the line stored in a certificate.

        n: number of states
        rated: whether to read the entry `rate`. Otherwise the rate is 0.

        Raises Malformed for the first wrong entry.
        """
        rate = entries.number("rate") if rated else 0.0
        return cls(entries.symmetric("H", n), entries.array("turn", n, n), rate)


def trim_content(trim: TrimBox) -> dict[str, Any]:
    """Return an enclosure of trims in the form that is stored in a certificate, with doubles."""
    numbers = {}
    for name, polynomial in trim.polynomials.items():
        c0, c1, c2, _, *errors = polynomial.parts
        numbers[name] = [float(each) for each in (trim.radii[name], c0, c1, c2, *errors)]
    return {"range": [trim.low, trim.high], "trim": numbers}
