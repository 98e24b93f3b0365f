"""Figure of the flights of drawn aircraft."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

from hfa_flight.samples.monte_carlo import MonteCarlo, fly_member, member_loop
from hfa_flight.simulate.flight import Flight, fly_within
from hfa_support.reporting.figure import new_figure
from hfa_support.reporting.text import shown_unit, shown_values

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Largest number of drawn aircraft in the figure.
_MOST_SHOWN = 200
#: Percentiles of the band that contains 95 %.
_BAND = (2.5, 97.5)
#: A state is drawn if it changes by more than this fraction of its nominal size.
_STILL = 1e-9


def drawn_figure(plan: MonteCarlo) -> Figure:
    """Return a figure with a row of two panels for each state that changes in a flight.

    The left panel shows the flight of the nominal aircraft. The right panel shows the differences
    of the drawn aircraft from the nominal aircraft, with the band that contains 95 % of them. At
    most `_MOST_SHOWN` aircraft are drawn.
    """
    compiled = member_loop(plan)
    itself = fly_within(compiled, plan.envelope, plan.member(0), plan.model.p)
    count = min(plan.members, _MOST_SHOWN)
    flights = [fly_member(plan, member) for member in range(count)]
    states = plan.model.states
    moving = [
        place
        for place, (name, signal) in enumerate(states.items())
        if max(np.ptp(each.states[:, place]) for each in (itself, *flights))
        > _STILL * signal.nominal
    ]
    figure = new_figure(10.0, 1.2 + 1.5 * len(moving))
    rows = figure.subplots(len(moving), 2, sharex=True, squeeze=False)
    for axes, place in zip(rows, moving, strict=True):
        _draw_state(axes, list(states)[place], place, itself, flights)
    handles, labels = rows[0, 1].get_legend_handles_labels()
    own, names = rows[0, 0].get_legend_handles_labels()
    entries = dict(zip([*names, *labels], [*own, *handles], strict=True))
    title = f"{plan.point.model.title}, law {plan.policy.name}: {count} drawn aircraft"
    figure.legend([*entries.values()], [*entries], loc="outside upper center", ncols=3, title=title)
    figure.align_ylabels(rows)
    rows[0, 0].set_title("the aircraft itself", fontsize=10)
    rows[0, 1].set_title("drawn aircraft - the aircraft itself", fontsize=10)
    for axes in rows[-1]:
        axes.set_xlabel("time, s")
    return figure


def _draw_state(axes: Any, name: str, place: int, itself: Flight, flights: list[Flight]) -> None:
    """Draw one state in the left and the right panel of a row of the figure."""
    unit = itself.point.model.unit(name)
    left, right = axes
    own = shown_values(itself.states[:, place], unit)
    left.plot(itself.time, own, color="black", linewidth=1.2, label="the aircraft itself")
    differences = np.full((len(flights), len(own)), np.nan)
    for row, flight in zip(differences, flights, strict=True):
        common = min(len(own), len(flight.states))  # a flight ends outside the envelope
        row[:common] = shown_values(flight.states[:common, place], unit) - own[:common]
        right.plot(itself.time, row, color="C0", linewidth=0.5, alpha=0.5, label="a drawn aircraft")
    band = np.nanpercentile(differences, _BAND, axis=0)
    right.fill_between(
        itself.time, *band, color="C0", alpha=0.2, linewidth=0.0, label="95 % of them"
    )
    left.set_ylabel(f"{name}, {shown_unit(unit)}")
    right.set_ylabel(f"Δ {name}, {shown_unit(unit)}")
    for each in axes:
        each.grid(alpha=0.3)
        each.ticklabel_format(useOffset=False)
