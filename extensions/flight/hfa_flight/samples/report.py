"""Report of a Monte Carlo simulation: counts of flights within limits, quantiles of errors."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

import numpy as np

from hfa_aircraft.limits import Limits
from hfa_aircraft.model import Model
from hfa_flight.air.scenario import Scenario
from hfa_flight.air.turbulence import level_text
from hfa_flight.needs import band_text, is_enough, need_text, outside_band
from hfa_flight.policies.filtered_policy import FilteredPolicy
from hfa_flight.policies.kalman import least_rms
from hfa_flight.policies.policy import OpenLoop
from hfa_flight.samples.monte_carlo import MonteCarlo
from hfa_flight.simulate.envelope import GIVE_LIMIT, NO_LIMIT, is_limited, note_on_air
from hfa_support.reporting.parts import Part
from hfa_support.reporting.report import Report, verdict_text
from hfa_support.reporting.results import storable
from hfa_support.reporting.rows import Group, Row
from hfa_support.reporting.text import Table, short_number, shown_unit, with_unit

#: Levels of the reported quantiles.
_QUANTILES = (0.05, 0.5, 0.95, 1.0)
#: Ratio of an rms to what is expected above which the first line names it.
_FAR = 3.0
#: Note if flights with noise leave the envelope under a policy without a filter.
_UNFILTERED = (
    "the policy acts on noisy measurements; --filter (Python: hfa.filter) estimates states"
)
#: Name of a result of `fly_members` -> its values, (N, ...), one row for each flight.
Flown = Mapping[str, np.ndarray]


def member_report(plan: MonteCarlo, flown: Flown, uncontrolled: Flown | None) -> Report:
    """Return the report of a Monte Carlo plan: flights that leave, and quantiles of the results.

    The quantiles are over the flights inside the envelope.

    flown: results of the flights
    uncontrolled: results of the same flights without control, by name, or None
    """
    outcomes = _outcomes(plan, flown)
    if uncontrolled is not None:
        outcomes["uncontrolled_within_limits"] = int(_within_limits(plan, uncontrolled).sum())
        if isinstance(plan.policy, FilteredPolicy):
            outcomes |= _rms_figures(plan, plan.policy, flown, uncontrolled)

    planned = (
        f"Monte Carlo, {plan.point.model.title}, policy {plan.policy.name}: {plan.members} flights "
        f"of {plan.scenario.duration:g} s, seed {plan.seed}"
    )
    advice = [] if is_limited(plan.envelope) else [GIVE_LIMIT]
    title = "\n".join(
        [_verdict(plan, outcomes) + _far_text(outcomes.get("rms_far_above", {})), planned, *advice]
    )

    rows = _rows(outcomes)
    parts: list[Part] = [Group("flights", rows)] if rows else []
    if "drawn" in outcomes:
        parts.append("flights are of aircraft with drawn parameters, from the trim of the model")
    if "rms" in outcomes:
        parts.append(_rms_table(plan, outcomes))
    if outcomes["held"]:
        parts.append(_quantile_table(plan, outcomes))
        if plan.limits.names != tuple(plan.model.states):
            parts.append(note_on_air(plan.limits))
    gust = plan.member(0).gust  # its text is that of every member
    if gust is not None and gust.text(plan.model):
        parts += [gust.text(plan.model), *gust.left_out(plan.model)]
    if isinstance(plan.policy, FilteredPolicy):
        parts += plan.policy.texts()
    parts += _least_text(plan)

    notes = []
    is_unfiltered = not isinstance(plan.policy, (FilteredPolicy, OpenLoop))
    if plan.scenario.uncertainty.noise and is_unfiltered and outcomes["first_left"] is not None:
        notes.append(_UNFILTERED)
    return Report(title, parts, notes, outcomes, _record_table(plan, flown))


def _verdict(plan: MonteCarlo, outcomes: Mapping[str, Any]) -> str:
    """Return the first line: flights within limits, and the share of the others."""
    within, members = outcomes["within_limits"], plan.members
    has_envelope = is_limited(plan.envelope)
    # The words are those of what was required: limits of all kinds, the envelope, or no divergence.
    if any(outcomes["exceeded"].values()) or any(outcomes["limit_cycle"].values()):
        stay, verb = "stay within limits", "do not"
    elif has_envelope:
        stay, verb = "stay inside", "leave"
    else:
        stay, verb = "do not diverge", "diverge"
    no_limit = "" if has_envelope else f"; {NO_LIMIT}"
    line = (
        f"{verdict_text(outcomes['ok'])}: {within} of {members} flights of "
        f"{plan.scenario.duration:g} s {stay}{_air_text(plan.scenario)}{_latency_text(plan)}"
        f"{need_text(plan.share)}{no_limit}"
    )
    if (without := outcomes.get("uncontrolled_within_limits")) is not None:
        line += f", without control {without} of {members}"
        line += ": the policy is worse" if without > within else ""
    outside = members - within
    band = band_text(outside, members, verb)
    if not outside:
        return f"{line}; {band}"
    left = {name: count for name, count in outcomes["left"].items() if count}
    of_states = f" by {next(iter(left)) if len(left) == 1 else _listed(left)}" if left else ""
    return f"{line}; {outside} {verb}{of_states} ({band})"


def _far_text(far: Mapping[str, Mapping[str, float]]) -> str:
    """Return which rms are far above the linear prediction or those without control, or ""."""
    names = {"linear": "the linear prediction", "no_control": "that without control"}
    text = ""
    for reference, name in names.items():
        ratios = [(far[state][reference], state) for state in far if reference in far[state]]
        if ratios:
            listed = ", ".join(f"{state} {ratio:.2g}" for ratio, state in sorted(ratios)[::-1])
            text += f"; rms {listed} times {name}"
    return text


def _far_above(plan: MonteCarlo, figures: Mapping[str, Any]) -> dict[str, dict[str, float]]:
    """Return state -> "linear" or "no_control" -> its rms by that reference, if above `_FAR`."""
    references = {"linear": figures.get("linear_rms", {})}
    # Flights that leave without control have no rms of their whole duration.
    if plan.scenario.moving_air and not figures["uncontrolled_left"]:
        references["no_control"] = figures["uncontrolled_rms"]
    far: dict[str, dict[str, float]] = {}
    for state in plan.model.linear:
        for reference, rms in references.items():
            if rms.get(state) and (ratio := figures["rms"][state] / rms[state]) > _FAR:
                far.setdefault(state, {})[reference] = ratio
    return far


def _air_text(scenario: Scenario) -> str:
    """Return the noise and the moving air of a scenario as text, such as " with noise"."""
    turbulence = scenario.uncertainty.turbulence
    words = "" if scenario.gust is None else " in a gust"
    if turbulence is not None:
        words = f" in {level_text(turbulence)}"
    return words + (
        " with noise" if any(sensor.noise for sensor in scenario.uncertainty.noise.values()) else ""
    )


def _latency_text(plan: MonteCarlo) -> str:
    """Return the latency, sensors and biases of flights of a policy in moving air or with noise."""
    uncertain = plan.scenario.uncertainty
    if isinstance(plan.policy, OpenLoop) or not (uncertain.noise or uncertain.turbulence):
        return ""
    return f" ({plan.scenario.text(plan.model)}{plan.policy.tolerates()})"


def _least_text(plan: MonteCarlo) -> list[str]:
    """Return what no policy can do whose commands act late in the turbulence, of the state whose
    rms is then the largest part of its distance to a limit.
    """
    turbulence, delay = plan.scenario.uncertainty.turbulence, plan.scenario.delay
    if turbulence is None or not delay:
        return []
    model = plan.model
    # the states come first
    ends = np.array([plan.limits.lowest, plan.limits.highest])[:, : len(plan.point.x)]
    nearest = dict(zip(model.states, np.abs(ends - plan.point.x).min(axis=0).tolist(), strict=True))
    least = least_rms(plan.point, turbulence, delay)
    name = max(least, key=lambda state: least[state] / nearest[state])
    value, limit = (with_unit(size, model.unit(name)) for size in (least[name], nearest[name]))
    return [
        f"No policy whose commands act {1e3 * delay:.4g} ms late has an rms of {name} below "
        f"{value} in this turbulence, on the linear aircraft (limit {limit}): the gusts of that "
        "time are not answered yet."
    ]


def _rms_figures(
    plan: MonteCarlo, policy: FilteredPolicy, flown: Flown, uncontrolled: Flown
) -> dict[str, Any]:
    """Return the root mean squares of flights with a filter, without control, and linear ones."""
    names = (*plan.model.linear, *plan.model.inputs)
    figures: dict[str, Any] = {
        "rms": dict(zip(names, _rms_of_all(flown), strict=True)),
        "uncontrolled_rms": dict(zip(names, _rms_of_all(uncontrolled), strict=True)),
        "uncontrolled_left": int((uncontrolled["left"] >= 0).sum()),
        "at_limit": dict(
            zip(plan.model.inputs, flown["at_limit"].mean(axis=0).tolist(), strict=True)
        ),
        "filter": storable(policy.filter),
        "margins": policy.margins,
    }
    # Only a stable linear loop has a root mean square to compare with.
    loop = policy.loop()
    if loop is not None and loop.radius < 1.0:
        samples = round(plan.scenario.duration / policy.dt)
        linear = loop.rms(samples).tolist()
        figures["linear_rms"] = dict(zip(names, linear, strict=True))
    return figures | {"rms_far_above": _far_above(plan, figures)}


def _rms_of_all(flown: Flown) -> list[float]:
    """Return the root mean squares of states and inputs over the time of all flights, (k + m,)."""
    seconds = flown["flown"]  # a flight counts by the time for which it stays inside
    squares = np.hstack([flown["rms_error"], flown["effort"]]) ** 2
    # more than 0 s, because all flights may leave at once
    return np.sqrt(seconds @ squares / max(float(seconds.sum()), 1e-9)).tolist()


def _rms_table(plan: MonteCarlo, outcomes: Mapping[str, Any]) -> Table:
    """Return the table of `_rms_figures`, with a row for each linear state and input."""
    rows = []
    for name, value in outcomes["rms"].items():
        unit = plan.model.unit(name)
        others = (outcomes["uncontrolled_rms"][name], outcomes.get("linear_rms", {}).get(name))
        cells = ["-" if shown is None else short_number(shown, unit) for shown in (value, *others)]
        share = outcomes["at_limit"].get(name)
        at = "-" if share is None else f"{100 * share:.2g}"
        rows.append((f"rms {name}", *cells, at, shown_unit(unit)))
    return Table(("all flights", "policy", "no control", "linear", "% at limit", "unit"), rows)


def _outcomes(plan: MonteCarlo, flown: Flown) -> dict[str, Any]:
    """Return the outcomes of all flights of a plan: the entries of the file."""
    model = plan.model
    # For each flight, the place in `limited` of the variable that left, and in `oscillating` of the
    # variable in a limit cycle; -1 for none.
    left, cycle = flown["left"], flown["cycle"]
    inside = left < 0
    departures = int((~inside).sum())
    obeyed = _inputs_within(model, flown)
    oscillating = (*model.inputs, *model.states)
    within_limits = int(_within_limits(plan, flown).sum())
    outcomes = {
        "schema": "hfa.monte-carlo-summary/1",
        "ok": is_enough(within_limits, plan.members, plan.share),
        "dynamics": model.name,
        "policy": plan.policy.name,
        "members": plan.members,
        "seed": plan.seed,
        "duration": plan.scenario.duration,
        "within_limits": within_limits,
        "held": int(inside.sum()),
        "first_left": None if inside.all() else float(flown["flown"][~inside].min()),
        # more than 0 s, because all flights may leave at once
        "left_an_hour": 3600.0 * departures / max(float(flown["flown"].sum()), 1e-9),
        "left": {name: int((left == index).sum()) for index, name in enumerate(plan.limits.names)},
        "left_95": outside_band(departures, plan.members),
        "exceeded": dict(zip(model.inputs, (~obeyed).sum(axis=0).tolist(), strict=True)),
        "limit_cycle": {
            name: int((cycle == index).sum()) for index, name in enumerate(oscillating)
        },
        "quantiles": np.array(_QUANTILES),
        **_quantiles(plan, flown, inside),
    }
    return outcomes if plan.spread is None else outcomes | {"drawn": list(plan.spread.values)}


def _inputs_within(model: Model, flown: Flown) -> np.ndarray:
    """Return whether each input of each flight is within its control limits, (N, m)."""
    limits = Limits.of(model, tuple(model.inputs))
    return np.asarray(limits.within(flown["lowest_input"]) & limits.within(flown["highest_input"]))


def _within_limits(plan: MonteCarlo, flown: Flown) -> np.ndarray:
    """Return whether each flight stays within all limits, (N,)."""
    is_obeyed = _inputs_within(plan.model, flown).all(axis=1)
    return np.asarray((flown["left"] < 0) & is_obeyed & (flown["cycle"] < 0))


def _rows(outcomes: Mapping[str, Any]) -> tuple[Row, ...]:
    """Return rows on each kind of failure that occurred."""
    rows = []
    if outcomes["first_left"] is not None:
        rows += [
            Row("departures", sum(outcomes["left"].values()), note=_listed(outcomes["left"])),
            Row("first departure", outcomes["first_left"], "s", digits=3),
            Row("departures an hour", outcomes["left_an_hour"], "1/h", digits=3),
        ]
    for name, entry in (("beyond limits of", "exceeded"), ("limit cycle of", "limit_cycle")):
        counts = outcomes[entry].items()
        rows += [Row(f"{name} {signal}", count) for signal, count in counts if count]
    return tuple(rows)


def _listed(counts: Mapping[str, int]) -> str:
    """Return text such as "alpha 3, pitch 1", without the counts that are 0."""
    return ", ".join(f"{name} {count}" for name, count in counts.items() if count)


def _variables(plan: MonteCarlo) -> dict[str, tuple[str, ...]]:
    """Return quantity of `fly_members` -> variables of its columns."""
    model = plan.model
    return {
        "rms_error": model.linear,
        "peak_error": model.linear,
        "effort": tuple(model.inputs),
        "final": tuple(model.states),
        "peak_deviation": tuple(name for name in plan.limits.names if name not in model.states),
    }


def _record_table(plan: MonteCarlo, flown: Flown) -> Table:
    """Return a row for each flight: the variable that left, time inside, and `_variables`."""
    header, columns = ["left", "flown [s]"], [flown["flown"]]
    for quantity, names in _variables(plan).items():
        header += [f"{quantity} {name} [{plan.limits.model.unit(name)}]" for name in names]
        columns.append(flown[quantity])
    left = [(*plan.limits.names, "")[place] for place in flown["left"]]
    rows = zip(left, np.column_stack(columns).tolist(), strict=True)
    return Table(tuple(header), [(name, *row) for name, row in rows])


def _quantiles(plan: MonteCarlo, flown: Flown, inside: np.ndarray) -> dict[str, Any]:
    """Return quantity -> variable -> quantiles of the flights inside, None without such flights."""
    variables = _variables(plan)
    if not inside.any():
        return {name: dict.fromkeys(names) for name, names in variables.items()}
    quantiles = {name: np.quantile(flown[name][inside], _QUANTILES, axis=0).T for name in variables}
    return {
        name: dict(zip(names, quantiles[name].tolist(), strict=True))
        for name, names in variables.items()
    }


def _quantile_table(plan: MonteCarlo, outcomes: Mapping[str, Any]) -> Table:
    """Return a table with one row for each variable of each quantity."""
    rows = []
    for quantity in ("rms_error", "peak_error", "effort", "peak_deviation"):
        for variable, values in outcomes[quantity].items():
            unit = plan.limits.model.unit(variable)
            cells = [short_number(value, unit) for value in values]
            name = f"{quantity.replace('_', ' ')} {variable}"
            rows.append((name, *cells, shown_unit(unit)))
    shares = ["largest" if share == 1.0 else f"{100 * share:g} %" for share in _QUANTILES]
    which = "flights inside the envelope" if is_limited(plan.envelope) else "flights not diverging"
    return Table((which, *shares, "unit"), rows)
