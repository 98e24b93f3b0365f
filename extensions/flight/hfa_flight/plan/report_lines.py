"""Lines and rows that the reports of one flight and of many share."""

from __future__ import annotations

from collections.abc import Sequence

from hfa_flight.plan.problem import FlightProblem
from hfa_flight.simulate.envelope import limits_text
from hfa_support.reporting.rows import Group, Row


def line_with_ratios(begin: str, outcomes: Sequence[tuple[str, float | None, str]]) -> str:
    """Return a first line with the cost ratios of policies, the last one first.

    begin: begin of the line
    outcomes: (name of the policy, ratio or None, how it is lost or "")

    >>> line_with_ratios("Best flight", [("gain of K.csv", 1.2, "leaves"), ("exact", 1.03, "")])
    'Best flight; exact 1.03x, gain 1.2x (leaves)'
    """
    said = [(name, _ratio_text(ratio, loss)) for name, ratio, loss in reversed(outcomes)]
    texts = [
        f"{name.partition(' of ')[0].removesuffix(', saturated')} {says}"
        for name, says in said
        if says
    ]
    return f"{begin}; {', '.join(texts)}" if texts else begin


def _ratio_text(ratio: float | None, loss: str) -> str:
    """Return a ratio and how flights are lost as text, such as "1.2x (leaves)"."""
    if ratio is None:
        return loss
    return f"{ratio:.4g}x ({loss})" if loss else f"{ratio:.4g}x"


def limits_of_flights(problem: FlightProblem) -> Group:
    """Return the limits of all states and of the moving inputs as rows."""
    model, envelope = problem.model, problem.envelope
    signals = [model.inputs[name] for name in problem.inputs]
    lows = [*envelope.lowest.tolist(), *(signal.min for signal in signals)]
    highs = [*envelope.highest.tolist(), *(signal.max for signal in signals)]
    assumed = [*envelope.assumed.tolist(), *(signal.assumed for signal in signals)]
    names = (*envelope.names, *problem.inputs)
    rows = []
    for name, low, high, is_assumed in zip(names, lows, highs, assumed, strict=True):
        unit = model.unit(name)
        text = limits_text(low, high, unit)
        rows.append(Row(name, text, unit, note="assumed" if is_assumed else ""))
    return Group("limits of flights", tuple(rows))
