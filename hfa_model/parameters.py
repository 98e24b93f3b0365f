"""Parameters of the aircraft, each with its unit, source and uncertainty."""

from __future__ import annotations

import json
import math
from copy import deepcopy
from dataclasses import dataclass, field, replace
from functools import cache
from pathlib import Path
from typing import TYPE_CHECKING, Any, Generic, NamedTuple, TypeAlias, TypeVar

import numpy as np

from hfa_aircraft.signals import Signal
from hfa_aircraft.uncertain import is_covariance, spread_of_set
from hfa_support.errors import BadInputError, refuse_unless_whole
from hfa_support.files import NUMBER, POSITIVE, read_named, write_text
from hfa_support.provenance import Change
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.results import ByValue
from hfa_support.reporting.text import Table

if TYPE_CHECKING:
    import casadi as ca


#: A number or a CasADi expression. Docstrings state the shape if it is not a single number. SX also
#: represents MX, because code that accepts one accepts the other; a union of both would permit
#: their sum.
Quantity: TypeAlias = "ca.SX | ca.DM | float"
#: Type of the values in a State, an Input, ...: numbers, CasADi expressions, units or scales.
T = TypeVar("T", covariant=True)

#: One degree in radians, used as 15 * DEGREE.
DEGREE = math.pi / 180


class State(NamedTuple, Generic[T]):
    """State X = [V, α, h, θ, q, η, η'] in the order of the paper (Section 2.2).

    The values are numbers, CasADi expressions, units or signals.

    speed: V, ft/s
    alpha: α, rad, angle of attack at the center of mass
    altitude: h, ft
    pitch: θ, rad
    pitch_rate: q, rad/s
    dihedral: η, rad, of both outer panels, tips up
    dihedral_rate: η', rad/s

    >>> from hfa_model import State
    >>> State(68.0, 0.05, 40000.0, 0.05, 0.0, 0.2, 0.0).dihedral
    0.2
    """

    speed: T
    alpha: T
    altitude: T
    pitch: T
    pitch_rate: T
    dihedral: T
    dihedral_rate: T


class Input(NamedTuple, Generic[T]):
    """Input U = [δ_t, δ_ac, δ_ao, δ_ec, δ_eo] in the order of the paper (Section 2.2).

    The values are numbers, CasADi expressions, units or signals.

    throttle: δ_t, 1; total thrust = thrust_per_throttle * throttle (`Parameters`)
    aileron_center: δ_ac, rad, positive with the trailing edge down
    aileron_outer: δ_ao, rad, positive with the trailing edge down
    elevator_center: δ_ec, rad, positive for more lift on the tail
    elevator_outer: δ_eo, rad, positive for more lift on the tail

    >>> from hfa_model import Input
    >>> Input(40.0, 0.0, 0.03, 0.0, -0.05).elevator_outer
    -0.05
    """

    throttle: T
    aileron_center: T
    aileron_outer: T
    elevator_center: T
    elevator_outer: T


#: The names of the seven states, in order.
STATES: tuple[str, ...] = State._fields
#: The names of the five inputs, in order.
INPUTS: tuple[str, ...] = Input._fields
#: The six states of the paper's linear model. The altitude is omitted, because it is not controlled
#: (Section 2.2).
LINEAR_STATES: tuple[str, ...] = tuple(name for name in STATES if name != "altitude")

#: Indices of these states among all seven.
LINEAR_ROWS = [STATES.index(name) for name in LINEAR_STATES]

#: Highest altitude of the atmosphere model, ft (the limit of 20 km geopotential altitude is at
#: 65,824 ft).
HIGHEST_ALTITUDE = 65_000.0

_ANGLE = Signal("rad", 0.1, rate=0.1)
_RATE = Signal("rad/s", 0.1, rate=1.0)


def _limited_angle(limit_deg: float) -> Signal:
    """Return an angle with the assumed limits ±limit_deg."""
    limit = math.radians(limit_deg)
    return _ANGLE._replace(min=-limit, max=limit, assumed=True)


#: Units, typical sizes and limits of the states. The typical rate of the speed is g; all other
#: typical rates are visible ones. The paper states no limits; the assumed ones mean attached flow
#: and the altitudes of the atmosphere model.
STATE_SIGNALS = State(
    speed=Signal("ft/s", 68.0, 1.0, 500.0, start=68.0, rate=32.2, assumed=True),
    alpha=_limited_angle(20),
    altitude=Signal("ft", 1000.0, 0.0, HIGHEST_ALTITUDE, rate=1.0, assumed=True),
    pitch=_limited_angle(60),
    pitch_rate=_RATE,
    dihedral=_limited_angle(60),
    dihedral_rate=_RATE,
)
_THROTTLE = Signal("1", 40.0, 0.0, 200.0, start=40.0, assumed=True)
_AILERON = _limited_angle(20)
_ELEVATOR = _limited_angle(30)
INPUT_SIGNALS = Input(_THROTTLE, _AILERON, _AILERON, _ELEVATOR, _ELEVATOR)

INPUT_UNITS: tuple[str, ...] = tuple(signal.unit for signal in INPUT_SIGNALS)
LINEAR_UNITS: tuple[str, ...] = tuple(getattr(STATE_SIGNALS, name).unit for name in LINEAR_STATES)


class Parameters(NamedTuple, Generic[T]):
    """Parameters of the aircraft as numbers or CasADi symbols, in ft, slug, lbf, s and rad.

    All three panels have equal mass, span, chord, tail, boom and inertias. Inertias are about the
    center of mass of the panel, in panel axes. The wing area of a panel is its span times its
    chord. Wing and tail have the same lift slope. `thrust_per_throttle` is the total thrust for a
    throttle of 1. Units and meanings are in `FIELDS`.
    """

    panel_mass: T
    panel_span: T
    chord: T
    tail_area: T
    boom_length: T
    inertia_roll: T
    inertia_pitch: T
    inertia_yaw: T
    lift_slope: T
    aileron_lift: T
    aileron_moment: T
    zero_lift_moment: T
    zero_lift_drag: T
    induced_drag: T
    hinge_stiffness: T
    hinge_damping: T
    thrust_per_throttle: T
    gravity: T


class Field(NamedTuple):
    """Unit and meaning of a parameter of the aircraft, for parameter files.

    unit: unit of the value
    meaning: description in words
    positive: whether the value must be positive
    """

    unit: str
    meaning: str
    positive: bool = True


FIELDS = Parameters(
    panel_mass=Field("slug", "mass of one panel"),
    panel_span=Field("ft", "span of one panel"),
    chord=Field("ft", "chord of the wing"),
    tail_area=Field("ft^2", "area of the all-moving tail of one panel"),
    boom_length=Field("ft", "distance from the wing's to the tail's quarter chord"),
    inertia_roll=Field(
        "slug ft^2", "inertia of one panel about its chordwise axis (I_x3x3 of the paper)"
    ),
    inertia_pitch=Field(
        "slug ft^2", "inertia of one panel about its spanwise axis (I_yy of the paper)"
    ),
    inertia_yaw=Field(
        "slug ft^2", "inertia of one panel about its normal axis (I_zz of the paper)"
    ),
    lift_slope=Field("1/rad", "lift coefficient per angle of attack, wing and tail"),
    aileron_lift=Field("1/rad", "lift coefficient per aileron deflection"),
    aileron_moment=Field(
        "1/rad",
        "pitching moment coefficient per aileron deflection, about the quarter chord",
        positive=False,
    ),
    zero_lift_moment=Field(
        "1", "pitching moment coefficient at zero lift, about the quarter chord", positive=False
    ),
    zero_lift_drag=Field("1", "drag coefficient at zero lift"),
    induced_drag=Field("1", "drag coefficient per squared lift coefficient"),
    hinge_stiffness=Field("ft lbf/rad", "elastic moment of one hinge per dihedral angle"),
    hinge_damping=Field("ft lbf s/rad", "damping moment of one hinge per dihedral rate"),
    thrust_per_throttle=Field("lbf", "total thrust per unit of throttle"),
    gravity=Field("ft/s^2", "acceleration of gravity"),
)
#: Possible sources of a value.
SOURCES = ("identified", "assumed", "print", "released")
_FILE: dict[str, Any] = {
    f"{name}*": {
        "value*": POSITIVE if spec.positive else NUMBER,
        "unit": (spec.unit,),
        "source": SOURCES,
        "note": str,
        "standard_error": NUMBER,
    }
    for name, spec in FIELDS._asdict().items()
} | {"covariance": {"names*": [str], "rows*": [[NUMBER]]}}


@dataclass(frozen=True, eq=False, repr=False)
class ParameterSet(ByValue, Reported):
    """Parameters of the aircraft with the source and the uncertainty of each.

    values: the parameters
    sources: name -> one of `SOURCES`
    notes: name -> reason for the value, for assumed values
    covariance: (n, n), covariance of the identified parameters in the order of `identified`, in
        their units, propagated from the rounding of the printed digits; (0, 0) if it is unknown
    name: name of the set or its file
    """

    values: Parameters[float]
    sources: dict[str, str]
    notes: dict[str, str] = field(default_factory=dict)
    covariance: np.ndarray = field(default_factory=lambda: np.zeros((0, 0)))
    name: str = field(default="of the user's own", compare=False)

    @property
    def identified(self) -> tuple[str, ...]:
        """Names of the identified parameters, in order."""
        return tuple(name for name in Parameters._fields if self.sources[name] == "identified")

    @property
    def standard_errors(self) -> dict[str, float]:
        """Standard error of each identified parameter, name -> value in the unit of the parameter.

        The mapping is empty if the covariance is unknown.
        """
        if not self.covariance.size:
            return {}
        return dict(zip(self.identified, np.sqrt(np.diag(self.covariance)).tolist(), strict=True))

    def table(self) -> Table:
        """Return a table of all parameters: value, standard error, unit and source."""
        errors = self.standard_errors
        rows = []
        for name, spec in FIELDS._asdict().items():
            error = f"{errors[name]:.2g}" if name in errors else "-"
            value = f"{getattr(self.values, name):.7g}"
            rows.append((name, value, error, spec.unit, self.sources[name]))
        return Table(("parameter", "value", "standard error", "unit", "source"), rows)

    def report(self) -> Report:
        """Return a report with the table of the parameters."""
        return Report("Parameters of the aircraft", (self.table(),))


#: Parameter sets in the package: name -> file.
NAMED = {
    "identified": Path(__file__).with_name("parameters.toml"),
    "gibson-2011-simulation": Path(__file__).with_name("parameters_gibson_2011_simulation.toml"),
}


def default_parameters() -> ParameterSet:
    """Return the identified parameters of the paper's aircraft, which are part of the package.

    >>> import hfa
    >>> round(hfa.paper.default_parameters().values.panel_mass, 2)  # slug
    9.33
    """
    return load_parameters("identified")


def load_parameters(name: str | Path) -> ParameterSet:
    """Return a set of parameters of the aircraft.

    name: name of a set in the package (`NAMED`), or the path of a file

    Raises BadInputError, which names the file, the entry and the fault, if the set is not valid.
    """
    if str(name) not in NAMED:
        return _read(str(name))
    return deepcopy(_packaged(str(name)))  # the cached set stays as it is


def _read(name: str) -> ParameterSet:
    """Return a set of parameters of the aircraft, read from its file.

    name: name in `NAMED`, or path
    """
    data = read_named("parameters", name, NAMED, _FILE)
    table = data.pop("covariance", {"names": [], "rows": []})
    names = Parameters._fields
    values = Parameters(*(data[parameter]["value"] for parameter in names))
    sources = {parameter: data[parameter].get("source", "assumed") for parameter in names}
    notes = {parameter: data[parameter]["note"] for parameter in names if "note" in data[parameter]}
    parameters = ParameterSet(values, sources, notes, name=name)
    rows = table["rows"]
    if rows and name not in NAMED:  # a test saves and loads the set of the package
        identified = list(parameters.identified)
        is_square = {len(row) for row in rows} == {len(rows)} == {len(identified)}
        if not (table["names"] == identified and is_square and is_covariance(np.array(rows))):
            raise BadInputError(
                f"{name}: [covariance] must list the identified parameters and be symmetric,"
                " without a negative eigenvalue; remove [covariance], or run"
                " `python -m studies.identification` again"
            )
    return replace(parameters, covariance=np.array(rows)) if rows else parameters


_packaged = cache(_read)  # read once, because the files do not change


def changed_parameters(parameters: ParameterSet) -> dict[str, Change]:
    """Return the parameters whose values differ from the identified ones, name -> change.

    A change consists of the value, the identified value and the unit.
    """
    identified = load_parameters("identified").values
    changes = {}
    for name, spec in FIELDS._asdict().items():
        value = getattr(parameters.values, name)
        usual = getattr(identified, name)
        if value != usual:
            changes[name] = Change(value, usual, spec.unit)
    return changes


def save_parameters(parameters: ParameterSet, path: Path, header: str) -> None:
    """Write a parameter file, from which `load_parameters` restores the exact values.

    An error leaves no partial file.

    parameters: the set
    path: path of the file
    header: comment at the beginning of the file
    """
    lines = [f"# {line}" for line in header.splitlines()]
    errors = parameters.standard_errors
    for name, spec in FIELDS._asdict().items():
        lines += [
            "",
            f"[{name}]",
            f"value = {getattr(parameters.values, name)!r}",
            f'unit = "{spec.unit}"',
            f'source = "{parameters.sources[name]}"',
        ]
        if name in errors:
            lines += [f"standard_error = {errors[name]:.3g}"]
        if name in parameters.notes:
            lines += [f"note = {json.dumps(parameters.notes[name])}"]  # JSON strings are valid TOML
    if parameters.covariance.size:
        names = ", ".join(f'"{name}"' for name in parameters.identified)
        rows = ",\n".join(f"  {row}" for row in parameters.covariance.tolist())
        lines += ["", "[covariance]", f"names = [{names}]", f"rows = [\n{rows},\n]"]
    write_text(path, "\n".join(lines) + "\n")


def sample_parameters(parameters: ParameterSet, count: int, seed: int) -> tuple[Parameters, ...]:
    """Return random samples of the identified parameters, p_i exp(z_i) with z ~ N(0, C_ij / (p_i
    p_j)).

    All other parameters are unchanged. The samples are Gaussian in the logarithms of the
    parameters. The printed matrices determine products and quotients of parameters much more
    precisely than single parameters.

    parameters: p and its covariance C
    count: number of samples
    seed: the same seed gives the same samples

    Raises BadInputError if there is no covariance, an identified parameter is zero, or count or
    seed is out of range.
    """
    if not parameters.covariance.size:
        raise BadInputError(
            "the parameters have no covariance, which random samples require; use the "
            "parameters.toml written by `python -m studies.identification`"
        )
    refuse_unless_whole("count", count, 1)
    refuse_unless_whole("seed", seed, 0)
    spread = spread_of_set(parameters)
    for name, value in spread.values.items():
        if value == 0.0:
            raise BadInputError(
                f"{name} is identified as 0, so the logarithm of {name} cannot be sampled; give "
                f"{name} a fixed value"
            )
    return tuple(
        parameters.values._replace(**dict(zip(parameters.identified, row, strict=True)))
        for row in spread.draws(count, seed).tolist()
    )


@cache
def published_data() -> dict[str, Any]:
    """Return the numbers printed in the paper, the content of `printed_matrices.json`.

    Raises ValueError if its states or inputs are not in the order of `LINEAR_STATES` and `INPUTS`.
    """
    text = Path(__file__).with_name("printed_matrices.json").read_text(encoding="utf-8")
    data: dict[str, Any] = json.loads(text)
    if tuple(data["states"]) != LINEAR_STATES or tuple(data["inputs"]) != INPUTS:
        raise ValueError(
            "printed_matrices.json: states or inputs are not in the order of hfa_model.parameters"
        )
    return data
