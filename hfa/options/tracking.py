"""Section on the tracking of a reference, which `--reference` adds to reports."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TYPE_CHECKING, Any

import numpy as np

from controller.riccati.lyapunov import stabilizes
from controller.tracking import tracked
from hfa.options.argument_types import each_of, linear_state
from hfa.options.option import option
from hfa_aircraft.model import Model
from hfa_aircraft.waveform import Waveform, channel, stacked
from hfa_support.errors import BadInputError
from hfa_support.reporting.report import Report

if TYPE_CHECKING:
    from controller.riccati.gare import Solution
    from hfa.options.games import NamedGame


def _signal(model: Model, name: str, text: str) -> Waveform:
    """Return the signal (1,) of a state, in the units of the model, of angles typed in degrees."""
    typed_unit = linear_state(model, name, "1")
    return channel(text).through(np.array([[typed_unit]]))


def reference_of(texts: Mapping[str, str], named: NamedGame) -> dict[str, Waveform]:
    """Return state -> signal of its deviation from the trim, from the texts of --reference.

    Raises BadInputError without an aircraft in continuous time, and for an unknown state or signal.
    """
    if not texts:
        return {}
    if named.linear is None:
        raise BadInputError("--reference requires an aircraft; remove --model")
    named.game.refuse_steps("--reference")
    return signals_of(texts, named.linear.model)


def signals_of(texts: Mapping[str, str], model: Model) -> dict[str, Waveform]:
    """Return state -> signal of its deviation from the trim, in the units of the model."""
    return each_of("--reference", model, texts, _signal)


def reference_option() -> Any:
    """Return the field `reference` of a request, with the option --reference."""
    return option(
        "track a reference: deviation of a state from the trim, a sum of terms such as 7, 0.01t, "
        "2sin(0.5t) with t in s, degrees for angles; repeatable",
        "NAME=SIGNAL",
        named=True,
        rare=True,
    )


def with_tracking(
    report: Report, reference: Mapping[str, Waveform], named: NamedGame, solution: Solution, K: Any
) -> Report:
    """Return a report with a section on tracking if a reference is given.

    reference: state -> signal, as of `reference_of`
    solution: exact solution of the game
    K: gain of the feedback, (m, n)
    """
    if not reference or named.linear is None:
        return report
    if not stabilizes(solution.game, K):
        abscissa = solution.level.poles(K).abscissa
        said = f"Tracking: no late errors, A - B K has abscissa {abscissa:+.4g} 1/s"
        return replace(report, parts=(*report.parts, said))
    commands = stacked(reference, named.linear.states)
    tracking = tracked(named.linear, solution, K, commands)
    section = tracking.report()
    parts = (*report.parts, section.title, *section.parts)
    return replace(report, parts=parts).with_data(tracking=tracking)
