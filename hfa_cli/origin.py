"""The provenance of every output: which program, aircraft and condition it comes from."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hfa_model.provenance import Provenance
    from hfa_support.reporting.report import Report
    from trim.point.condition import TrimCondition

_RUN: ContextVar[tuple[str, argparse.Namespace] | None] = ContextVar("run", default=None)


@contextmanager
def run_of(words: Sequence[str], arguments: argparse.Namespace) -> Iterator[None]:
    """What is signed inside comes from these words."""
    token = _RUN.set((shlex.join(["hfa", *words]), arguments))
    try:
        yield
    finally:
        _RUN.reset(token)


def provenance() -> Provenance:
    """Of the run that is under way."""
    from hfa_model.provenance import Provenance, changed_parameters, parameter_hash

    run = _RUN.get()
    if run is None:
        raise LookupError("nothing is run: provenance() belongs inside run_of()")
    command, arguments = run
    if (own := getattr(arguments, "aircraft", None)) is not None:
        return Provenance(command, model=f"{own.source[0]} (SHA-256 {own.source[1][:12]})", condition=_own(arguments))
    if getattr(arguments, "model", None) is not None:
        return Provenance(command, model=str(arguments.model))
    if not hasattr(arguments, "parameters"):
        return Provenance(command)
    from hfa_cli.options.shared_options import parameters_of

    chosen, flight = parameters_of(arguments), _flight(arguments)
    return Provenance(
        command,
        dynamics=getattr(arguments, "dynamics", "both"),
        parameters=chosen.name,
        parameter_hash=parameter_hash(chosen.values),
        changed={**changed_parameters(chosen), **_held(arguments)},
        condition=_condition(arguments, flight),
        flight="" if flight is None else flight.in_words(),
    )


def _held(arguments: argparse.Namespace) -> dict[str, tuple[float, float]]:
    """The parameters of the unsteady dynamics that --hold changes -> their value, and the identified or usual one."""
    if getattr(arguments, "dynamics", "") != "unsteady":
        return {}
    from hfa_model.unsteady import UNSTEADY

    held = {name: value for name, value in (getattr(arguments, "hold", None) or {}).items() if isinstance(value, float)}
    return {name: (held[name], each.start) for name, each in UNSTEADY.parameters.items() if name in held}


def _own(arguments: argparse.Namespace) -> dict[str, object]:
    """What the trims of a user's own aircraft impose beside its declaration, and its parameters that --hold changes."""
    from hfa_cli.options.shared_options import flight_of, swept_condition_of

    if not hasattr(arguments, "hold"):
        return {}
    flight = swept_condition_of(arguments) if hasattr(arguments, "samples") else flight_of(arguments)
    own, held = arguments.aircraft, arguments.hold or {}
    return {**flight.to_dict(), "parameters": {name: held[name] for name in own.parameters if name in held}}


def origin_lines() -> str:
    """The provenance of the run and its command, for the top of a source file."""
    return f"{provenance().text()}\n{provenance().command}"


def signed(report: Report) -> Report:
    """The report with the provenance of the run, as its last line and in its data."""
    from dataclasses import replace

    origin = provenance()
    return replace(report, source=origin.text()).with_data(provenance=origin.to_dict())


def _flight(arguments: argparse.Namespace) -> TrimCondition | None:
    """What all trims of the run have in common, as changes of the paper's level flight; None of a run without one."""
    from hfa_cli.options.shared_options import flight_of, swept_condition_of

    if hasattr(arguments, "samples"):
        return swept_condition_of(arguments)
    alone = isinstance(getattr(arguments, "dihedral", None), float)
    return flight_of(arguments) if hasattr(arguments, "start") and (alone or hasattr(arguments, "sweep")) else None


def _condition(arguments: argparse.Namespace, flight: TrimCondition | None) -> dict[str, object]:
    """What the trim of the run imposes (rad, ft/s, ft), frees and limits; of many trims what they change."""
    if flight is None:
        return {}
    if hasattr(arguments, "sweep") or hasattr(arguments, "samples"):
        return flight.to_dict()
    condition = flight.at(arguments.dihedral)
    limits = {name: list(condition.limits_of(name)) for name in condition.free}
    return {"imposed": dict(condition.imposed), "free": list(condition.free), "limits": limits}
