"""Balances: identities of flight, whose two sides are equal at all states of any aircraft.

So are their derivatives, which shows a wrong sign where both sides are 0. The sides are made of
outputs, states, rates and parameters, with the exact derivatives of the model; no data of other
aircraft are used.
"""

from __future__ import annotations

import math
import re
from collections.abc import Iterator, Sequence
from functools import cache, lru_cache
from itertools import chain
from types import SimpleNamespace
from typing import NamedTuple

import casadi as ca
import numpy as np

from hfa_aircraft.control_systems import is_linear_plant
from hfa_aircraft.rigid.atmosphere import (
    HEAT_RATIO,
    air_at,
    calibrated_airspeed,
)
from hfa_support.matrices import ROUNDING
from hfa_support.reporting.rows import Row
from hfa_support.reporting.text import digits_with_unit, shown_unit
from hfa_support.units import KNOT, STANDARD_GRAVITY, conversion_factor, units_like
from trim.reports.trimmed import QUANTITIES, ROLES, Known, Trimmed

#: Angle, rad, rate, rad/s, or share of the speed by which a derivative changes two sides.
_SMALL = 0.1
#: Share of the tolerances within which all hold with the one change that explains failures.
_EXPLAINED = 0.25
#: Quantities that follow from the altitude, and from Mach number and dynamic pressure.
_OF_AIR = ("standard_pressure", "standard_density", "kcas_of_mach")
_NAMES = (*ROLES, *(f"{role}_dot" for role in ROLES), *QUANTITIES, *_OF_AIR)


class Balance(NamedTuple):
    """Two sides that are equal at all states of an aircraft, in SI units.

    name: what is balanced
    left, right: the sides
    size: what their difference is compared with; inf if only the signs of derivatives are equal
    unit: unit of the sides
    tolerance: largest difference, as a share of the size, or of its change by `_SMALL`
    by: roles by which the sides are differentiated, or the input that pitches the aircraft most
    is_steady: whether the sides are equal only in a trim, as declared loads are of steady flow
    """

    name: str
    left: ca.SX
    right: ca.SX
    size: ca.SX
    unit: str
    tolerance: float
    by: tuple[str, ...] = ()
    is_steady: bool = False


_SEA_LEVEL_DENSITY = float(air_at(0.0, "si").density)
_SHORT = ("sin_climb_angle", "heading_rate", "load_of_gravity", "path_rate")
_s = SimpleNamespace(**{name: ca.SX.sym(name) for name in (*_NAMES, *_SHORT)})
_one, _path = ca.SX(1.0), ("theta", "alpha")
BALANCES = (
    Balance("rate of pitch", _s.theta_dot, _s.q * ca.cos(_s.phi) - _s.r * ca.sin(_s.phi),
        _SMALL * _one, "rad/s", 0.05, ("q",)),
    Balance("rate of roll", _s.phi_dot, _s.p + ca.sin(_s.theta) * _s.heading_rate,
        _SMALL * _one, "rad/s", 0.05, ("p",)),
    Balance("rate of yaw", _s.yaw_dot, _s.heading_rate, _SMALL * _one, "rad/s", 0.05, ("r",)),
    Balance("turn rate", _s.turn_rate, _s.heading_rate, _SMALL * _one, "rad/s", 0.05, ("r",)),
    Balance("rate of altitude", _s.altitude_dot, _s.speed * _s.sin_climb_angle,
        _s.speed, "m/s", 0.05, _path),
    Balance("climb rate", _s.climb_rate, _s.speed * _s.sin_climb_angle,
        _s.speed, "m/s", 0.05, _path),
    Balance("flight path", ca.sin(_s.gamma), _s.sin_climb_angle, _one, "1", 0.05, _path),
    Balance("load factor", _s.load_factor,
        _s.load_of_gravity + _s.speed * _s.path_rate / _s.gravity, _one, "1", 0.1, ("alpha", "q")),
    Balance("force across the path", _s.load_factor * _s.weight,
        _s.lift + _s.thrust * ca.sin(_s.alpha), _s.weight, "N", 0.2, (), True),
    Balance("force along the path", _s.weight * _s.speed_dot / _s.gravity,
        _s.thrust * ca.cos(_s.alpha) - _s.drag - _s.weight * _s.sin_climb_angle,
        ca.fabs(_s.thrust) + ca.fabs(_s.drag) + 0.01 * _s.weight, "N", 0.15, ("theta",)),
    Balance("weight", _s.weight, _s.mass * _s.gravity, _s.weight, "N", 0.03),
    Balance("pressure of the air", _s.dynamic_pressure,
        HEAT_RATIO / 2.0 * _s.standard_pressure * _s.mach**2, _s.dynamic_pressure, "N/m^2", 0.2),
    Balance("density of the air", _s.dynamic_pressure, _s.standard_density * _s.speed**2 / 2.0,
        _s.dynamic_pressure, "N/m^2", 0.3),
    Balance("calibrated airspeed", _s.kcas, _s.kcas_of_mach, _s.kcas, "m/s", 0.02),
    Balance("equivalent airspeed", _SEA_LEVEL_DENSITY * _s.keas**2 / 2.0, _s.dynamic_pressure,
        _s.dynamic_pressure, "N/m^2", 0.04),
    Balance("lift coefficient", _s.dynamic_pressure * _s.reference_area * _s.lift_coefficient,
        _s.lift, _s.lift, "N", 0.05, (), True),
    Balance("drag coefficient", _s.dynamic_pressure * _s.reference_area * _s.drag_coefficient,
        _s.drag, _s.drag, "N", 0.05, (), True),
    Balance("pitching moment", _s.q_dot, _s.pitching_moment, math.inf * _one, "1", 1.0, ("input",)),
)  # fmt: skip


class _Equations(NamedTuple):
    """Balances as a function of the quantities in the order of `_NAMES`, (k,).

    function: -> left, right and size of each balance, (N, 3), and derivatives of the 2N sides by
        the quantities, (2N, k)
    reads: the quantities of each balance
    """

    function: ca.Function
    reads: list[list[str]]


@cache
def _equations(in_body_axes: bool) -> _Equations:
    """Return the balances, for models with u, v, w or with speed, alpha and beta as states."""
    s, sin, cos = _s, ca.sin, ca.cos
    V = ca.sqrt(s.u**2 + s.v**2 + s.w**2)
    in_plane = s.u**2 + s.w**2
    V_dot = (s.u * s.u_dot + s.v * s.v_dot + s.w * s.w_dot) / V
    of_components = (
        (s.speed_dot, V_dot),
        (s.alpha_dot, (s.u * s.w_dot - s.w * s.u_dot) / in_plane),
        (s.speed, V),
        (s.alpha, ca.atan2(s.w, s.u)),
        (s.beta, ca.asin(s.v / V)),
    )
    flow = sin(s.beta) * sin(s.phi) + sin(s.alpha) * cos(s.beta) * cos(s.phi)
    across = s.p * cos(s.alpha) + s.r * sin(s.alpha)
    meanings = (
        (s.sin_climb_angle, cos(s.alpha) * cos(s.beta) * sin(s.theta) - flow * cos(s.theta)),
        (s.heading_rate, (s.q * sin(s.phi) + s.r * cos(s.phi)) / cos(s.theta)),
        (s.load_of_gravity, sin(s.alpha) * sin(s.theta) + cos(s.alpha) * cos(s.theta) * cos(s.phi)),
        (s.path_rate, cos(s.beta) * (s.q - s.alpha_dot) - sin(s.beta) * across),
        *(of_components if in_body_axes else ()),
    )
    rows = ca.vertcat(*(ca.horzcat(each.left, each.right, each.size) for each in BALANCES))
    for symbol, meaning in meanings:
        rows = ca.substitute(rows, symbol, meaning)
    quantities = ca.vertcat(*(getattr(s, name) for name in _NAMES))
    slopes = ca.jacobian(ca.vec(rows[:, :2]), quantities)
    reads = [[each.name() for each in ca.symvar(rows[i, :])] for i in range(len(BALANCES))]
    return _Equations(ca.Function("balances", [quantities], [rows, slopes]), reads)


def _known_of(trimmed: Trimmed) -> dict[str, Known]:
    """Return the quantities of `_NAMES` that a model has."""
    excluded: set[str] = set()
    if trimmed.model.about.equations == "JSBSim":  # further forces of a file are in no output
        excluded |= {"drag", "pitching_moment"}
    if trimmed.in_wind:  # these may be relative to the ground
        excluded |= {"gamma", "climb_rate", "altitude_dot"}
    known = {name: each for name, each in trimmed.quantities.items() if name not in excluded}
    none = np.zeros(len(trimmed.model.states) + len(trimmed.model.inputs))
    constants: dict[str, float] = {"gravity": STANDARD_GRAVITY}
    if "altitude" in known:
        air = air_at(known["altitude"].value, "si")
        constants |= {"standard_pressure": air.pressure, "standard_density": air.density}
    pressure, mach = (
        known[name].value if name in known else 0.0 for name in ("dynamic_pressure", "mach")
    )
    if min(pressure, mach) > 0.0:
        constants["kcas_of_mach"] = KNOT * calibrated_airspeed(pressure, mach)
    return {name: Known("", "", float(each), none) for name, each in constants.items()} | known


class Balances(NamedTuple):
    """Balances at a point.

    evaluated: number of those whose quantities the model has
    sentences: a sentence on each of them that fails
    lacking: names of those that were not evaluated
    """

    evaluated: int
    sentences: list[str]
    lacking: list[str]


class _Failure(NamedTuple):
    """Number of a balance that fails, and its sides or their derivatives by a variable."""

    number: int
    sides: tuple[float, float]
    by: str


class _Evaluation:
    """Balances of a point, also with quantities multiplied by factors."""

    def __init__(self, trimmed: Trimmed) -> None:
        """Collect the quantities of the model."""
        self.trimmed = trimmed
        self.known = _known_of(trimmed)
        self.in_body_axes = "speed" not in trimmed.roles and "w" in trimmed.roles
        self.function, self.reads = _equations(self.in_body_axes)
        self.columns = (*trimmed.model.states, *trimmed.model.inputs)
        blank = Known("", "", 1.0, np.zeros(len(self.columns)))
        self.quantities = [self.known.get(name, blank) for name in _NAMES]
        self.evaluated = [
            number
            for number, each in enumerate(BALANCES)
            if self.known.keys() >= {*self.reads[number]}
            and (trimmed.point.ok or not each.is_steady)
        ]

    def failures(
        self, changed: str = "", factor: float = 1.0, share: float = 1.0
    ) -> Iterator[_Failure]:
        """Yield the balances that fail.

        changed: name in the model of a quantity that is multiplied by the factor
        share: of the tolerances
        """
        factors = np.array([factor if each.name == changed else 1.0 for each in self.quantities])
        values = np.array([each.value for each in self.quantities]) * factors
        by_columns = np.array([each.slopes for each in self.quantities]) * factors[:, None]
        rows, slopes = (part.full() for part in self.function(values))
        derivatives = (slopes @ by_columns).reshape(2, len(BALANCES), -1)
        for number in self.evaluated:
            balance = BALANCES[number]
            left, right, size = rows[number]
            is_signs = math.isinf(size)
            tolerance = balance.tolerance if is_signs else share * balance.tolerance
            if abs(left - right) > tolerance * abs(size):  # nan is no failure
                yield _Failure(number, (left, right), "")
                continue
            for column, change in self._by(balance):
                a, b = derivatives[:, number, self.columns.index(column)]
                least = 0.0 if is_signs else abs(size) / change
                if abs(a - b) > tolerance * max(abs(a), abs(b), least):
                    yield _Failure(number, (a, b), column)
                    break

    def _by(self, balance: Balance) -> Iterator[tuple[str, float]]:
        """Yield the variables by which a balance is differentiated, and their small changes."""
        roles, model = self.trimmed.roles, self.trimmed.model
        for role in balance.by:
            if role == "input" and model.inputs:
                effects = self.known["pitching_moment"].slopes[len(model.states) :]
                effects = np.abs(effects) * model.nominal(model.inputs)
                if effects.any():
                    yield [*model.inputs][int(np.argmax(effects))], _SMALL
            elif role in roles:
                yield roles[role], _SMALL
            elif role == "alpha" and self.in_body_axes:
                yield roles["w"], _SMALL * abs(self.known["u"].value)

    def cures(self, names: Sequence[str]) -> list[str]:
        """Return the changes of one of the named quantities with which all balances hold: its sign,
        its unit or, if none of these, a factor of 2.
        """
        found = []
        units = {each.name: each.unit for each in self.known.values()}
        for only_factors in (False, True):
            for name in names:
                unit = units[name]
                others = units_like(unit) if unit else []  # a rate has the unit ""
                factors = {f"{name} in {other}": conversion_factor(other, unit) for other in others}
                factors[f"the sign of {name}"] = -1.0
                if name == "weight":
                    gravity = STANDARD_GRAVITY / (0.3048 if unit == "lbf" else 1.0)
                    factors["a mass as weight"] = gravity
                if only_factors:
                    factors = {f"{name} twice": 0.5, f"{name} half": 2.0}
                for words, factor in factors.items():
                    if not any(self.failures(name, factor or 1.0, _EXPLAINED)):
                        found.append(words)
            if found:
                break
        return found

    def sentence(self, failure: _Failure) -> str:
        """Return both sides of a balance that fails, in units of the model."""
        balance, trimmed = BALANCES[failure.number], self.trimmed
        named = {name: each.name or name for name, each in self.known.items()}
        units = [self.known[name].unit for name in self.reads[failure.number]]
        unit = next((u for u in units if u and conversion_factor(u, balance.unit)), balance.unit)
        factor = conversion_factor(balance.unit, unit) or 1.0
        by = ""
        if failure.by:
            of = trimmed.unit(failure.by)
            by = f" per {shown_unit(of)} of {failure.by}"
            factor *= conversion_factor(shown_unit(of), of) or 1.0
        least = ROUNDING * max(map(abs, failure.sides))
        texts = []
        for side, value in zip((balance.left, balance.right), failure.sides, strict=True):
            equation = re.sub(r"[a-z_]+", lambda word: named.get(word[0], word[0]), _text(side))
            number = digits_with_unit(factor * value * (abs(value) > least), unit, 4)
            texts.append(f"{equation} is {number}{by}")
        return f"{balance.name}: {', '.join(texts)}"


def _text(side: ca.SX) -> str:
    """Return a side as text, without brackets around the whole."""
    text = str(side)
    depths = np.cumsum([(mark == "(") - (mark == ")") for mark in text])
    return text[1:-1] if text[0] == "(" and depths[:-1].min() > 0 else text


@lru_cache(maxsize=4)
def balances_of(trimmed: Trimmed) -> Balances:
    """Return the balances of a point, which need not be a trim: they hold also where a search has
    ended. None is evaluated without derivatives, and for a plant of matrices.
    """
    if trimmed.fault or is_linear_plant(trimmed.model):
        return Balances(0, [], [])
    evaluation = _Evaluation(trimmed)
    lacking = [each.name for i, each in enumerate(BALANCES) if i not in evaluation.evaluated]
    failures = [*evaluation.failures()]
    sentences = []
    if failures:
        states = {*trimmed.model.states, ""}
        read = [
            [evaluation.known[name].name for name in evaluation.reads[failure.number]]
            for failure in failures
        ]
        names = [name for name in dict.fromkeys(chain(*read)) if name not in states]
        shared = [name for name in names if all(name in each for each in read)]
        cures = evaluation.cures(names)
        advice = f"{' or '.join(cures)}?" if cures else f"check {', '.join(shared or names)}"
        sentences = [f"{evaluation.sentence(failure)}; {advice}" for failure in failures]
    return Balances(len(evaluation.evaluated), sentences, lacking)


def balances_rows(trimmed: Trimmed) -> Iterator[Row]:
    """Yield the row of the balances of a point, and one of those that were not evaluated."""
    evaluated, sentences, lacking = balances_of(trimmed)
    if evaluated:
        holding = f"{evaluated - len(sentences)} of {evaluated}"
        yield Row("balances", holding, note="hold", tone="bad" if sentences else "")
        if lacking:
            yield Row("balances not evaluated", "; ".join(lacking), rare=True)
