"""Options of every trim, of the aircraft, of outputs and workers, and the aircraft and conditions
that they name."""

from __future__ import annotations

import argparse
import warnings
from collections.abc import Callable, Iterable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import hfa_model
from hfa.options.argument_types import (
    OWN,
    PICTURES,
    model,
    one_of,
    output_file,
    place,
    quantity,
    span,
    whole,
)
from hfa.options.parser import Option, Options
from hfa_aircraft.model import Model
from hfa_model.parameters import NAMED, ParameterSet, default_parameters, load_parameters
from hfa_model.variants import variant_named
from hfa_support.errors import BadInputError, NoSolutionError, refuse_unknown
from hfa_support.reporting.report import SUFFIXES, Report
from hfa_support.reporting.unit_system import SYSTEMS
from trim.hfa.level_flight import CONDITIONS, load_condition
from trim.point.condition import (
    TrimCondition,
    release,
    usual_condition,
)
from trim.point.operating_point import OperatingPoint
from trim.point.solve import TrimError, find_operating_point

if TYPE_CHECKING:
    pass

#: All that says where the aircraft is trimmed, the scheduling variable apart.
OF_THE_TRIM = ("condition", "free", "hold", "limit", "start")
MOST_WORKERS = 1000
#: Suffixes of the report itself. A page of HTML holds its pictures; nothing is written beside a
#: text.
REPORTS: dict[str, Callable[[Report], str]] = {
    ".md": Report.markdown,
    ".html": lambda report: f'<!doctype html>\n<meta charset="utf-8">\n{report.html()}',
}
#: Commands without --units: what they compare, prove or write is in ft, slug, lbf, and says so.
IN_FEET = ("regenerate", "prove", "lpv", "export")


#: The HFA.
HFA_OPTIONS: Options = {
    "--dynamics": Option(
        "published (regenerates the printed matrices; default), newton (exact mechanics, the same air loads) or "
        "unsteady (newton with air that has mass and memory, and tails that feel pitch rate)",
        "VARIANT",
        default="published",
    ),
    "--parameters": Option(
        f"parameters file, or {' or '.join(NAMED)} (default: identified)", "FILE", load_parameters
    ),
}
#: The HFA, or a model of the user's own, which `main` has loaded.
AIRCRAFT: Options = {
    "--aircraft": Option(
        "an aircraft of your own, or package.module:NAME; the file is executed; default: the HFA",
        "FILE.py:NAME",
        lambda _: OWN.get(),
    ),
    **HFA_OPTIONS,
}
UNITS: Options = {
    "--units": Option(
        "of what is typed, printed, drawn and written: english (ft, slug, lbf; default) or si (m, kg, N)",
        "UNITS",
        one_of(*SYSTEMS),
        "english",
    )
}
JSON: Options = {"--json": Option("print JSON (angles in radians) instead of text")}


def at(
    kind: Callable[[str], Any] = place,
    form: str = "",
    about: str = "",
    *,
    default: Any = None,
    required: bool = False,
) -> Options:
    """--at: the scheduling variable of the model, of the HFA also --dihedral. kind, form, default:
    of its values."""
    by = model().schedule
    unit = model().schedule_unit if by else ""
    words = ", ".join(
        filter(None, (by or "the scheduling variable", "degrees" if unit == "deg" else unit, about))
    )
    called = "--at --dihedral" if by == "dihedral" else "--at"
    more = {"required": required and by == "dihedral"}
    return {
        called: Option(
            words,
            form or ("DEG" if unit == "deg" else "VALUE"),
            kind if by else _nowhere,
            default,
            more=more,
        )
    }


def _nowhere(_: str) -> None:
    raise BadInputError(f"is of a scheduling variable; {model().name} declares none")


def design(about: str = "") -> Options:
    """--design: of the HFA or the user's own aircraft."""
    about = about or "actuators, integrals, sensors, weights: paper, servo, or a .toml file"
    return {"--design": Option(about, "NAME", _design)}


def _design(name: str) -> Any:
    from controller.servo.design import load_design

    return load_design(name, model())


def flights(
    kind: Callable[[str, str], Any] = quantity, form: str = "VALUE", about: str = ""
) -> Options:
    """What a trim imposes and leaves free besides. kind, form, about: the values of --hold, and
    what it does."""
    of = model()
    own = [
        f"{name} {of.describe(name, value)}"
        for name, value in of.trim.items()
        if name != of.schedule
    ]
    usual = f"hold a variable, by default {', '.join(own[:4])}" if own else "hold a variable"
    lists = "; or a list of points, .csv: a row of names, then a row each, typed as in --hold"
    files = f"file, or {', '.join(CONDITIONS)}; what it imposes in place of the usual values"
    return {
        "--condition": Option(files + lists * (kind is not quantity), "FILE", _condition),
        "--free": Option(
            "leave a variable free; repeatable", "NAME", default=(), more={"action": "append"}
        ),
        "--hold": Option(f"{about or usual}; repeatable", f"NAME={form}", kind, named=True),
        "--limit": Option(
            "limits of an unknown, degrees for angles; repeatable",
            "NAME=LOW:HIGH",
            span,
            named=True,
        ),
        "--start": Option(
            "begin from a saved operating point (.json), or with these values: NAME=VALUE,NAME=VALUE",
            "FILE",
            _start,
        ),
    }


def trim(*, required: bool = False) -> Options:
    """A single trim, and the aircraft."""
    return {**at(required=required), **flights(), **AIRCRAFT}


def output(*also: str, what: str = "") -> Options:
    """--json and --output; `also`: further suffixes; `what`: their purpose."""
    known = (*SUFFIXES, *REPORTS)
    about = f"also write {', '.join(known)}" + (f" or {', '.join(also)}{what}" if also else "")
    return {**JSON, "-o --output": Option(about, "FILE", output_file(*known, *also))}


def picture(what: str) -> Options:
    """--picture, which draws the named thing."""
    return {
        "--picture": Option(f"draw {what} ({', '.join(PICTURES)})", "FILE", output_file(*PICTURES))
    }


def workers(what: str) -> Options:
    """--workers, --resume."""
    return {
        "--workers": Option(
            "processes, or a Dask scheduler, tcp://host:port; default 1", "N|URL", _workers, {}
        ),
        "--resume": Option(f"continue an interrupted {what}"),
    }


def _condition(text: str) -> TrimCondition | Path:
    """A condition, or the path of a list of them."""
    return (
        Path(text)
        if text.lower().endswith(".csv")
        else load_condition(text, usual_condition(model()))
    )


def _start(text: str) -> OperatingPoint | dict[str, float]:
    """A saved operating point, or the values of some variables."""
    if "=" not in text or Path(text).exists():
        return OperatingPoint.load(Path(text), model())
    words = dict(word.partition("=")[::2] for word in text.split(","))
    for name in words:
        refuse_unknown("no variable is called", name, model().variables)
    return {name: quantity(name, word) for name, word in words.items()}


def _workers(text: str) -> dict[str, Any]:
    """A number of processes, or the address of a Dask scheduler, as `stream` takes them."""
    return {"scheduler": text} if "://" in text else {"count": whole(1, MOST_WORKERS)(text)}


def refuse(arguments: argparse.Namespace, names: Iterable[str], reason: str) -> None:
    """BadInputError for the first option of these that was given: it would change nothing."""
    for name in names:
        if name in arguments.given:
            raise BadInputError(f"--{name.replace('_', '-')} {reason}")


def refuse_si(arguments: argparse.Namespace, reason: str) -> None:
    """BadInputError when --units si is given with --output, whose file is always in feet."""
    if arguments.units == "si":
        refuse(arguments, ("output",), f"does not go with --units si: {reason}; leave one out")


# The aircraft.


def parameters_of(arguments: argparse.Namespace) -> ParameterSet:
    """The parameters of the HFA that the options name."""
    chosen: ParameterSet | None = arguments.parameters
    return default_parameters() if chosen is None else chosen


def aircraft_of(arguments: argparse.Namespace) -> Model:
    """The HFA, or the user's own model with the parameters that --hold names; the unsteady dynamics
    are such a one."""
    if OWN.get() is None:
        return hfa_model.aircraft(arguments.dynamics, parameters_of(arguments).values)
    own: Model | None = arguments.aircraft
    if own is None:
        from hfa_model.unsteady import UNSTEADY

        own = UNSTEADY.with_parameters(**parameters_of(arguments).values._asdict())
    else:
        refuse(
            arguments,
            ("dynamics", "parameters"),
            "belongs to the HFA; --hold imposes parameters of --aircraft",
        )
    return own.with_parameters(**held_parameters(arguments))


def held_parameters(arguments: argparse.Namespace) -> dict[str, float]:
    """The parameters of the model in use that the options hold at one value."""
    held = {**getattr(arguments, "hold", {}), model().schedule: arguments.at}
    return {name: held[name] for name in model().parameters if isinstance(held.get(name), float)}


def hfa_of(arguments: argparse.Namespace) -> Model:
    """The HFA that the options name, of a command that takes no other."""
    variant_named(arguments.dynamics)
    return hfa_model.aircraft(arguments.dynamics, parameters_of(arguments).values)


# The trims.


def flights_of(arguments: argparse.Namespace) -> TrimCondition:
    """What all trims of the options have in common, the scheduling variable apart."""
    own, by = model(), model().schedule
    usual, free, held = (
        arguments.condition or usual_condition(own),
        tuple(arguments.free),
        arguments.hold,
    )
    for name in free:
        if name in held:
            raise BadInputError(f"{name} is both set free and held; name it once")
    if arguments.at is not None:
        if by in held:
            raise BadInputError(
                f"{by} is given twice, by --{called_at()} and by --hold; give it once"
            )
        # One value is where the search for a free one begins.
        if by in free and not isinstance(arguments.at, float):
            raise BadInputError(
                f"{by} is given by --{called_at()} and set free by --free; leave one of them out"
            )
    if isinstance(usual, Path):
        raise BadInputError(f"--condition {usual} is a list of points; `hfa sweep` takes it")
    constant = {
        name: value if isinstance(value, float) else value[0]
        for name, value in held.items()
        if isinstance(value, float) or is_constant(name, value)
    }
    if OWN.get() is not None:
        constant = {name: value for name, value in constant.items() if name not in own.parameters}
    changed = release(usual, free=free, hold=constant, limits=arguments.limit)
    begin = arguments.start if isinstance(arguments.start, dict) else {}
    return replace(changed, begin={**changed.begin, **begin}) if begin else changed


def called_at() -> str:
    """What people call --at."""
    return "dihedral" if model().schedule == "dihedral" else "at"


def is_constant(name: str, values: Any) -> bool:
    """Whether --hold of a sweep imposes one value on a trim variable; a parameter is always one of
    its axes."""
    return isinstance(values, tuple) and len(values) == 1 and name not in model().parameters


def condition_of(arguments: argparse.Namespace) -> TrimCondition:
    """The trim that the options name."""
    return flights_of(arguments).at(
        None if model().schedule in model().parameters else arguments.at
    )


def start_of(arguments: argparse.Namespace) -> OperatingPoint | None:
    """The saved point that --start names."""
    return arguments.start if isinstance(arguments.start, OperatingPoint) else None


def point_of(arguments: argparse.Namespace, aircraft: Model) -> OperatingPoint:
    """The trim at the condition that the options name, begun where --start says.

    Raises TrimError that also says so where a held angle of attack is why there is no trim.
    """
    condition, by, start = condition_of(arguments), model().schedule, start_of(arguments)
    if arguments.at is not None and by in condition.free:
        begins = (
            f"--{called_at()} {model().describe(by, arguments.at)}"
            if arguments.start is None
            else "--start"
        )
        warnings.warn(f"{by} is free: the search begins at {begins}", stacklevel=2)
    try:
        return find_operating_point(aircraft, condition, start)
    except TrimError as error:
        if "alpha" not in condition.imposed:
            raise
        try:
            free = find_operating_point(aircraft, release(condition, free=("alpha",)), start)
        except NoSolutionError:
            raise error from None
        held, found = (
            model().describe("alpha", each)
            for each in (condition.imposed["alpha"], free.states.alpha)
        )
        how = "leave --hold alpha out and " * ("alpha" in arguments.hold) + "add --free alpha"
        raise TrimError(
            f"{error}; alpha is held at {held}, free it trims at {found}: {how}", error.attempt
        ) from None
