"""Report of a Monte Carlo simulation: counts of flights within limits, quantiles of errors."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import Any

import numpy as np

from hfa_aircraft.model import Model
from hfa_flight.air.names import ANGLE_OF_ATTACK, OVER_GROUND, has_angle_of_attack, limited_names
from hfa_flight.envelope import control_limits
from hfa_flight.needs import is_enough, need_text
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.scenario import Uncertainty
from hfa_support.reporting.checks import verdict_text
from hfa_support.reporting.report import Part, Report
from hfa_support.reporting.text import Table, short_number, shown_unit

#: Levels of the reported quantiles.
_QUANTILES = (0.05, 0.5, 0.95, 1.0)
#: Note if all members are the same flight.
_ALIKE = "all members are the same flight; give parameter errors, noise or turbulence"
#: Function from the name of a result of `fly_members` to its values, (N, ...).
Read = Callable[[str], np.ndarray]


def member_report(plan: MonteCarlo, read: Read, where: str) -> Report:
    """Return the report of a Monte Carlo plan: outcomes, and quantiles of the results.

    The quantiles are over the members inside the envelope.

    read: function from the name of a result to its values, (N, ...), one row for each member
    where: where the members are stored, for the title
    """
    found = _outcomes(plan, read)
    flown = (
        f"Monte Carlo, {plan.point.model.title}, law {plan.policy.name}: {plan.members} members of "
        f"{plan.scenario.duration:g} s, seed {plan.seed}, {where}"
    )
    verdict = verdict_text(is_enough(found["within_limits"], plan.members, plan.share))
    inside = f"{found['within_limits']} of {plan.members} members stayed within limits"
    inside += need_text(plan.share)
    title = "\n".join([f"{verdict}: {inside}", flown, *_failures(found)])
    parts: list[Part] = []
    if found["held"]:
        parts.append(_quantile_table(plan, found))
        if plan.scenario.moving_air and has_angle_of_attack(plan.model):
            parts.append(OVER_GROUND)
    gust = plan.member(0).gust
    if gust is not None and gust.text(plan.model):
        parts += [gust.text(plan.model), *gust.left_out(plan.model)]
    alike = plan.scenario.uncertainty == Uncertainty() and plan.spread is None
    return Report(title, parts, [_ALIKE] if alike else [], found)


def _outcomes(plan: MonteCarlo, read: Read) -> dict[str, Any]:
    """Return the outcomes of all flights of a plan: the entries of the file."""
    model = plan.model
    left = read("left")
    cycle = read("cycle")
    inside = left < 0
    limits = control_limits(model)
    within = limits.within(read("lowest_input")) & limits.within(read("highest_input"))
    states = limited_names(model, plan.scenario.moving_air)
    oscillating = (*model.inputs, *model.states)
    found = {
        "schema": "hfa.monte-carlo-summary/1",
        "dynamics": model.name,
        "law": plan.policy.name,
        "members": plan.members,
        "seed": plan.seed,
        "duration": plan.scenario.duration,
        "within_limits": int((inside & within.all(axis=1) & (cycle < 0)).sum()),
        "held": int(inside.sum()),
        "first_left": None if inside.all() else float(read("flown")[~inside].min()),
        "left": {name: int((left == index).sum()) for index, name in enumerate(states)},
        "exceeded": dict(zip(model.inputs, (~within).sum(axis=0).tolist(), strict=True)),
        "limit_cycle": {name: int((cycle == at).sum()) for at, name in enumerate(oscillating)},
        "quantiles": np.array(_QUANTILES),
        **_quantiles(model, read, inside),
    }
    return found if plan.spread is None else found | {"drawn": list(plan.spread.values)}


def _failures(found: Mapping[str, Any]) -> list[str]:
    """Return lines on the drawn aircraft, if any, and on each kind of failure that occurred."""
    lines = []
    if "drawn" in found:
        lines.append(
            "members are aircraft with drawn parameters, each simulated from the trim of the model"
        )
    if found["first_left"] is not None:
        lines.append(
            f"left the envelope (members by first state): {_listed(found['left'])};"
            f" the earliest after {found['first_left']:.3g} s"
        )
    if any(found["exceeded"].values()):
        lines.append(f"exceeded control limits: {_listed(found['exceeded'])}")
    if any(found["limit_cycle"].values()):
        lines.append(f"limit cycle that does not decay: {_listed(found['limit_cycle'])}")
    return lines


def _listed(counts: Mapping[str, int]) -> str:
    """Return text such as "alpha 3, pitch 1", without the counts that are 0."""
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


def _quantiles(model: Model, read: Read, inside: np.ndarray) -> dict[str, Any]:
    """Return quantity -> variable -> values at the levels of the members inside, or None."""
    variables: dict[str, tuple[str, ...]] = {
        "rms_error": model.linear,
        "peak_error": model.linear,
        "effort": tuple(model.inputs),
        "final": tuple(model.states),
    }
    values = {name: read(name) for name in variables}
    if has_angle_of_attack(model):
        variables["peak_deviation"] = (ANGLE_OF_ATTACK,)
        values["peak_deviation"] = read("peak_angle_of_attack")[:, None]
    if not inside.any():
        return {name: dict.fromkeys(names) for name, names in variables.items()}
    levels = {name: np.quantile(values[name][inside], _QUANTILES, axis=0).T for name in variables}
    return {
        name: dict(zip(names, levels[name].tolist(), strict=True))
        for name, names in variables.items()
    }


def _quantile_table(plan: MonteCarlo, found: Mapping[str, Any]) -> Table:
    """Return a table with one row for each variable of each quantity."""
    shown = ["rms_error", "peak_error", "effort"]
    if plan.scenario.moving_air and "peak_deviation" in found:
        shown.append("peak_deviation")
    rows = []
    for quantity in shown:
        for variable, values in found[quantity].items():
            unit = plan.model.unit(variable)
            cells = [short_number(value, unit) for value in values]
            name = f"{quantity.replace('_', ' ')} {variable}"
            rows.append((name, *cells, shown_unit(unit)))
    shares = ["largest" if share == 1.0 else f"{100 * share:g} %" for share in _QUANTILES]
    return Table(("members inside the envelope", *shares, "unit"), rows)
