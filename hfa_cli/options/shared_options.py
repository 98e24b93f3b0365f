"""Options that several commands share, and the objects that they make."""

from __future__ import annotations

import argparse
import math
import os
import warnings
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from hfa_cli.options.argument_types import (
    OWN,
    PICTURES,
    number,
    one_angle,
    one_of,
    output_file,
    parsed,
    quantity,
    span,
    whole,
)
from hfa_cli.options.parser import add_named, add_value
from hfa_model.aircraft import HFA, Aircraft
from hfa_model.parameters import NAMED, ParameterSet, default_parameters, load_parameters
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown, shortened
from hfa_support.model import Model
from hfa_support.reporting.data_files import SUFFIXES
from hfa_support.reporting.report import Report
from hfa_support.reporting.unit_system import SYSTEMS
from trim.point.condition import LEVEL_FLIGHT, TrimCondition, release, usual_condition
from trim.point.named_condition import NAMED as NAMED_CONDITIONS, load_condition
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, find_operating_point

if TYPE_CHECKING:
    from verification.enclosures.trim_branch import Family

DEFAULT_DYNAMICS = "published"
_HOLD = "hold speed (ft/s, default 68), altitude (ft, 40000), alpha (deg, 2.8), gamma (deg, 0) or any other variable"
#: All that says where the aircraft is trimmed, the dihedral angle apart.
OF_THE_TRIM = ("condition", "free", "hold", "limit", "start")
MOST_WORKERS = 1000
#: Suffixes of the report itself. A page of HTML holds its pictures; nothing is written beside a text.
REPORTS: dict[str, Callable[[Report], str]] = {
    ".md": lambda report: report.without_pictures().markdown(),
    ".html": lambda report: f'<!doctype html>\n<meta charset="utf-8">\n{report.html()}',
}
#: Commands without --units: what they compare, prove or write is in ft, slug, lbf, and says so.
IN_FEET = ("regenerate", "prove", "lpv", "export")


def add_own(parser: argparse.ArgumentParser) -> None:
    """--aircraft: a model of the user's own, which `main` has loaded."""
    about = "an aircraft of your own, or package.module:NAME; the file is executed; default: the HFA"
    add_value(parser, "--aircraft", lambda _: OWN.get(), "FILE.py:NAME", about)


def own_of(arguments: argparse.Namespace) -> Model | None:
    """The user's own aircraft, with the parameters that --hold names; None is the HFA."""
    own: Model | None = getattr(arguments, "aircraft", None)
    held = {name: value for name, value in (getattr(arguments, "hold", None) or {}).items() if isinstance(value, float)}
    if own is None:
        if OWN.get() is None:
            return None
        from hfa_model.unsteady import UNSTEADY

        effects = {name: value for name, value in held.items() if name in UNSTEADY.parameters}
        return UNSTEADY.with_parameters(**parameters_of(arguments).values._asdict(), **effects)
    refuse(arguments, ("dihedral", "parameters"), "belongs to the HFA; hold variables and parameters with --hold")
    if arguments.dynamics != DEFAULT_DYNAMICS:
        raise BadInputError("--dynamics belongs to the HFA; leave it out with --aircraft")
    return own.with_parameters(**{name: value for name, value in held.items() if name in own.parameters})


def add_aircraft(parser: argparse.ArgumentParser) -> None:
    """--dynamics, --parameters."""
    equations = "published (regenerates the printed matrices; default), newton (exact mechanics, the same air loads) "
    equations += "or unsteady (newton with air that has mass and memory, and tails that feel pitch rate)"
    add_value(parser, "--dynamics", str, "VARIANT", equations, default=DEFAULT_DYNAMICS)
    add_parameters(parser)


def add_design(parser: argparse.ArgumentParser, about: str = "") -> None:
    """--design: of the HFA or the user's own aircraft."""
    from controller.design.design import NAMED as DESIGNS, load_design

    about = about or f"actuators, integrals, sensors, weights: {', '.join(DESIGNS)}, or a .toml file"
    add_value(parser, "--design", parsed(lambda name: load_design(name, OWN.get() or HFA)), "NAME", about)


def add_parameters(parser: argparse.ArgumentParser) -> None:
    """--parameters: the aircraft, whatever its equations."""
    about = f"parameters file, or {' or '.join(NAMED)} (default: identified)"
    add_value(parser, "--parameters", parsed(load_parameters), "FILE", about)


def add_condition(parser: argparse.ArgumentParser, *, dihedral_required: bool = True) -> None:
    """Options of every trim: --dihedral, --condition, --free, --hold, --limit, --start."""
    add_value(
        parser,
        "--dihedral",
        one_angle,
        "DEG",
        "dihedral angle, degrees",
        required=dihedral_required and (OWN.get() or HFA).schedule == "dihedral",
    )
    add_flight(parser)


def add_flight(parser: argparse.ArgumentParser) -> None:
    """What a trim imposes and leaves free, the dihedral angle apart."""
    add_changes(parser, quantity, "VALUE", f"{_HOLD}; repeatable")


def add_changes(parser: argparse.ArgumentParser, kind: Callable[[str, str], Any], form: str, about: str) -> None:
    """--condition, --free, --hold, --limit, --start; kind, form, about: the value of --hold, and what it does."""
    named = f"file, or {', '.join(NAMED_CONDITIONS)}; what it imposes in place of the paper's values"
    if kind is not quantity:
        named += "; or a list of points, .csv: a row of names, then a row each, typed as in --hold"
    add_value(parser, "--condition", parsed(_condition), "FILE", named)
    parser.add_argument("--free", action="append", metavar="NAME", help="leave a variable free; repeatable")
    add_named(parser, "--hold", kind, f"NAME={form}", about)
    add_named(parser, "--limit", span, "NAME=LOW:HIGH", "limits of an unknown, degrees for angles; repeatable")
    about = "begin from a saved operating point (.json), or with these values: NAME=VALUE,NAME=VALUE"
    add_value(parser, "--start", parsed(_start), "FILE", about)


def _condition(text: str) -> TrimCondition | Path:
    """A condition, or the path of a list of them."""
    return Path(text) if text.lower().endswith(".csv") else load_condition(text, _usual())


def _start(text: str) -> OperatingPoint | dict[str, float]:
    """A saved operating point, or the values of some variables."""
    if "=" not in text or Path(text).exists():
        return OperatingPoint.load(Path(text), OWN.get() or HFA)
    words = dict(word.partition("=")[::2] for word in text.split(","))
    for name in words:
        refuse_unknown("no variable is called", name, (OWN.get() or HFA).variables)
    return {name: quantity(name, word) for name, word in words.items()}


def add_output(parser: argparse.ArgumentParser, *also: str, what: str = "") -> None:
    """--json and --output; `also`: further suffixes; `what`: their purpose."""
    add_json(parser)
    known = (*SUFFIXES, *REPORTS)
    about = f"also write {', '.join(known)}" + (f" or {', '.join(also)}{what}" if also else "")
    parser.add_argument("-o", "--output", type=output_file(*known, *also), metavar="FILE", help=about)


def add_json(parser: argparse.ArgumentParser) -> None:
    """--json: print the data of the report."""
    parser.add_argument("--json", action="store_true", help="print JSON (angles in radians) instead of text")


def add_picture(parser: argparse.ArgumentParser, what: str) -> None:
    """--picture, which draws the named thing."""
    add_value(parser, "--picture", output_file(*PICTURES), "FILE", f"draw {what} ({', '.join(PICTURES)})")


def add_workers(parser: argparse._ActionsContainer, what: str) -> None:
    """--workers, --resume."""
    add_value(parser, "--workers", _workers, "N|URL", "processes, or a Dask scheduler, tcp://host:port; default 1")
    parser.add_argument("--resume", action="store_true", help=f"continue an interrupted {what}")


def cores() -> int:
    """Processes that run at once on this machine."""
    return min(os.cpu_count() or 1, MOST_WORKERS)


def given(arguments: argparse.Namespace, name: str) -> bool:
    """Whether an option was given; an empty word counts, so that it is refused and not passed over."""
    value = getattr(arguments, name)
    return value is not None and value is not False


def refuse(arguments: argparse.Namespace, names: tuple[str, ...], reason: str) -> None:
    """BadInputError for the first option of these that was given: it would change nothing."""
    for name in names:
        if given(arguments, name):
            raise BadInputError(f"--{name.replace('_', '-')} {reason}")


def parameters_of(arguments: argparse.Namespace) -> ParameterSet:
    """The parameters that the options name."""
    chosen: ParameterSet | None = arguments.parameters
    return default_parameters() if chosen is None else chosen


def aircraft_of(arguments: argparse.Namespace) -> Aircraft:
    """The HFA that the options name."""
    return Aircraft(parameters_of(arguments).values, arguments.dynamics)


def crew_of(arguments: argparse.Namespace) -> dict[str, Any]:
    """Who works, and whether on an interrupted job, as `stream` takes it."""
    workers = arguments.workers or 1
    count, scheduler = (1, workers) if isinstance(workers, str) else (workers, None)
    return {"count": count, "scheduler": scheduler, "resume": arguments.resume}


def _workers(text: str) -> int | str:
    """The type of --workers: a number of processes, or the address of a Dask scheduler."""
    return text if "://" in text else whole(1, MOST_WORKERS)(text)


def condition_of(arguments: argparse.Namespace) -> TrimCondition:
    """The flight that the options name: a named condition, changed by --hold, --free and --limit."""
    return flight_of(arguments).at(arguments.dihedral)


def flight_of(arguments: argparse.Namespace, *, dihedral_is_free: bool = True) -> TrimCondition:
    """The flights that the options name but for the dihedral."""
    return changed_condition(arguments, arguments.hold or {}, dihedral_is_free=dihedral_is_free)


def changed_condition(
    arguments: argparse.Namespace, hold: Mapping[str, float], *, dihedral_is_free: bool = True
) -> TrimCondition:
    """The condition that --condition names, changed by --free, --limit and the held values.

    dihedral_is_free: --dihedral does not hold the angle against --free, because it is always given.
    """
    free = tuple(arguments.free or ())
    for name in free:
        if name in (arguments.hold or {}):
            raise BadInputError(f"{name} is both set free and held; name it once")
    if given(arguments, "dihedral"):
        if "dihedral" in (arguments.hold or {}):
            raise BadInputError("dihedral is given twice, by --dihedral and by --hold; give it once")
        if "dihedral" in free and not dihedral_is_free:
            raise BadInputError("dihedral is given by --dihedral and set free by --free; leave one of them out")
    usual = arguments.condition or _usual()
    if isinstance(usual, Path):
        raise BadInputError(f"--condition {usual} is a list of points; `hfa sweep` takes it")
    if (own := OWN.get()) is not None:
        for name in hold:
            own.refuse_unheld(f"--hold names nothing of {own.name}:", name, tuple(own.parameters))
    hold = {name: value for name, value in hold.items() if name not in usual.model.parameters or OWN.get() is None}
    changed = release(usual, free=free, hold=hold, limits=arguments.limit)
    if isinstance(arguments.start, dict):
        changed = replace(changed, begin={**changed.begin, **arguments.start})
    return changed


def start_of(arguments: argparse.Namespace) -> OperatingPoint | None:
    """The saved point that --start names."""
    return arguments.start if isinstance(arguments.start, OperatingPoint) else None


def _usual() -> TrimCondition:
    own = OWN.get()
    return LEVEL_FLIGHT if own is None else usual_condition(own)


def swept_condition_of(arguments: argparse.Namespace) -> TrimCondition:
    """What every point of a sweep has in common: the variables that --hold has one value for, and the other changes."""
    held = {name: values[0] for name, values in (arguments.hold or {}).items() if is_constant(name, values)}
    return changed_condition(arguments, held, dihedral_is_free=False)


def is_constant(name: str, values: Any) -> bool:
    """Whether --hold of a sweep imposes one value on a trim variable; a parameter is always one of its axes."""
    return isinstance(values, tuple) and len(values) == 1 and name not in (OWN.get() or HFA).parameters


def operating_point_of(arguments: argparse.Namespace, aircraft: Aircraft | Model) -> OperatingPoint:
    """The trim at the condition that the options name, begun where --start says.

    Raises TrimError that also says so where a held angle of attack is why there is no trim.
    """
    condition = condition_of(arguments)
    if "dihedral" in condition.free and OWN.get() is None:
        typed = f"--dihedral {math.degrees(arguments.dihedral):g}"
        begins = f"the search begins at {typed}" if arguments.start is None else "the search begins at --start"
        warnings.warn(f"dihedral is free: {begins}", stacklevel=2)
    try:
        return find_operating_point(aircraft, condition, start_of(arguments))
    except TrimError as error:
        if not (advice := freed_alpha(arguments, aircraft, condition)):
            raise
        raise TrimError(f"{error}; {advice}", error.attempt) from None


def freed_alpha(arguments: argparse.Namespace, aircraft: Aircraft | Model, condition: TrimCondition) -> str:
    """What to type where a held angle of attack is why a condition has no trim; "" where it is not why."""
    if "alpha" not in condition.imposed:
        return ""
    try:
        point = find_operating_point(aircraft, release(condition, free=("alpha",)), start_of(arguments))
    except NoSolutionError:
        return ""
    held, found = (
        condition.model.describe("alpha", value) for value in (condition.imposed["alpha"], point.states.alpha)
    )
    how = f"{'leave --hold alpha out and ' if 'alpha' in (arguments.hold or {}) else ''}add --free alpha"
    return f"alpha is held at {held}, free it trims at {found}: {how}"


def add_units(parser: argparse.ArgumentParser) -> None:
    """--units: units of typed, printed, drawn and written numbers."""
    about = "of what is typed, printed, drawn and written: english (ft, slug, lbf; default) or si (m, kg, N)"
    add_value(parser, "--units", one_of(*SYSTEMS), "UNITS", about)


def refuse_files(arguments: argparse.Namespace, names: tuple[str, ...], reason: str) -> None:
    """BadInputError when --units si is given with an option whose file is always in feet."""
    for name in names:
        if arguments.units == "si" and getattr(arguments, name) is not None:
            raise BadInputError(
                f"--units si does not go with --{name} {getattr(arguments, name)}: {reason}; leave one out"
            )


# Flights over an interval of the scheduling variable, about which something is proved.


def add_flights(parser: argparse.ArgumentParser, form: str) -> None:
    """--dihedral in degrees, or --at; what a trim imposes and leaves free; the aircraft."""
    about = "degrees; what is proved holds at every angle between"
    add_value(parser, "--dihedral", places, form, about)
    add_value(parser, "--at", places, "LOW:HIGH", "with --aircraft: of its scheduling variable, an angle in degrees")
    add_flight(parser)
    add_own(parser)
    add_aircraft(parser)


def places(text: str) -> tuple[float, ...]:
    """`LOW:HIGH` or one place, as written: the statement is about these numbers."""
    parts = text.split(":")
    if len(parts) > 2:
        raise argparse.ArgumentTypeError(f"is {shortened(text)!r}; give LOW:HIGH")
    ends = tuple(number(part) for part in parts)
    if len(ends) == 2 and not ends[0] < ends[1]:
        raise argparse.ArgumentTypeError(f"is {shortened(text)!r}; the first end must be the lower one")
    return ends


def family_of(arguments: argparse.Namespace, errors: float = 0.0) -> Family:
    """The aircraft and the flights that the options name; the scheduling variable is left.

    errors: every identified parameter may be off by this many of its standard errors.
    """
    from verification.enclosures.trim_branch import Family

    own, flights = own_of(arguments), flight_of(arguments)
    if own is None and arguments.at is not None:
        raise BadInputError("--at goes with --aircraft; of the HFA give --dihedral LOW:HIGH")
    known = {} if own is not None else parameters_of(arguments).standard_errors
    if errors and not known:
        raise BadInputError("the parameters have no standard errors; leave --error out")
    spread = {name: errors * error for name, error in known.items() if errors * error > 0.0}
    return Family(own or aircraft_of(arguments), flights, spread)


def interval_of(arguments: argparse.Namespace, family: Family) -> tuple[float, float]:
    """LOW:HIGH, in places; refused where no trim can be."""
    option = "--dihedral LOW:HIGH, degrees" if arguments.aircraft is None else "--at LOW:HIGH"
    ends: tuple[float, ...] = arguments.at or arguments.dihedral or ()
    if len(ends) != 2:
        raise BadInputError(f"give the interval of {family.over or 'the scheduling variable'} as {option}")
    if arguments.at is not None and family.over in (arguments.hold or {}):
        raise BadInputError(f"{family.over} is given twice, by --at and by --hold; give it once")
    family.check(*ends)
    return ends[0], ends[1]


def at_one_place(arguments: argparse.Namespace) -> float | None:
    """The dihedral, deg, when one is given; the options then name a trim like those of other commands."""
    if arguments.at is not None:
        raise BadInputError("a game is at one place; hold the scheduling variable by --hold NAME=VALUE")
    if arguments.dihedral is None:
        return None
    if len(arguments.dihedral) != 1:
        raise BadInputError("a game is at one dihedral; give --dihedral DEG")
    angle_deg = float(arguments.dihedral[0])
    arguments.dihedral = math.radians(angle_deg)
    return angle_deg
