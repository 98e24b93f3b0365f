"""What every output of a run bears: which program, aircraft and condition it comes from."""

from __future__ import annotations

import argparse
import shlex
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from contextvars import ContextVar
from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from hfa_model.provenance import Provenance
    from hfa_model.reporting.report import Report

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
    if getattr(arguments, "model", None) is not None:
        return Provenance(command, model=str(arguments.model))
    if not hasattr(arguments, "parameters"):
        return Provenance(command)
    from hfa_cli.options.shared_options import parameters_of

    chosen = parameters_of(arguments)
    return Provenance(
        command,
        dynamics=getattr(arguments, "dynamics", "both"),
        parameters=chosen.name,
        parameter_hash=parameter_hash(chosen.values),
        changed=changed_parameters(chosen),
        condition=_condition(arguments),
    )


def origin_lines() -> str:
    """The provenance of the run and its command, for the top of a source file."""
    return f"{provenance().text()}\n{provenance().command}"


def signed(report: Report) -> Report:
    """The report with the provenance of the run, as its last line and in its data."""
    from dataclasses import replace

    origin = provenance()
    return replace(report, source=origin.text()).with_data(provenance=origin.to_dict())


def _condition(arguments: argparse.Namespace) -> dict[str, object]:
    """What the trim of the run imposes (rad, ft/s, ft), frees and limits; empty for a run without one.

    Of a sweep, what its points have in common and what it changes of the paper's level flight.
    """
    from hfa_cli.options.shared_options import condition_of

    if hasattr(arguments, "sweep") and hasattr(arguments, "start"):
        from hfa_cli.options.shared_options import flight_of

        return flight_of(arguments).to_dict()
    if hasattr(arguments, "vary"):
        from hfa_cli.options.shared_options import swept_condition_of

        return swept_condition_of(arguments).to_dict()
    if not isinstance(getattr(arguments, "dihedral", None), float) or not hasattr(arguments, "start"):
        return {}
    condition = condition_of(arguments)
    limits = {name: list(condition.limits_of(name)) for name in condition.free}
    return {"imposed": dict(condition.imposed), "free": list(condition.free), "limits": limits}
