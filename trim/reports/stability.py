"""Static stability and control gradients at a trim."""

from __future__ import annotations

from collections.abc import Iterator

from hfa_support.reporting.rows import Lacking, Row
from trim.reports.trimmed import Trimmed

#: Methods of the control gradients.
_PER_G = "steady pull-up; lags follow"
_PER_KNOT = "trims 0.5 kt slower and faster"
#: Figures that derivatives give.
_FIGURES = ("static margin", "neutral point behind c.g.", "control per g", "control per knot")


def stability_rows(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield static margin and neutral point, and the control per load factor and per knot."""
    if not {"speed", "alpha"} <= {*trimmed.roles}:
        return
    if trimmed.fault:
        for name in _FIGURES:
            yield Lacking(name, "a derivative is not a number")
        return
    yield from static_margin(trimmed)
    yield from control_gradients(trimmed)


def static_margin(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the slopes of lift and pitching moment, the static margin -(∂M/∂α) / (c ∂L/∂α) with the
    other rigid-body states and the inputs fixed while lags follow, and the neutral point, margin
    times chord behind the center of gravity.
    """
    names = ("lift", "pitching_moment", "dynamic_pressure", "reference_area", "reference_chord")
    if reason := trimmed.lacks(*names) or trimmed.zero(*names[2:]):
        yield Lacking("static margin", reason)
        yield Lacking("neutral point behind c.g.", reason)
        return
    chord = trimmed["reference_chord"]
    steady = trimmed.quasi_steady
    place = steady.states.index(trimmed.roles["alpha"])
    lift, moment = (float(steady.outputs[name].by_states[place]) for name in names[:2])
    force = trimmed["dynamic_pressure"] * trimmed["reference_area"]
    yield Row("CL_alpha", lift / force, "1/rad")
    yield Row("Cm_alpha", moment / (force * chord), "1/rad")
    if lift:
        margin = -moment / (lift * chord)
        yield Row("static margin", margin, "chord")
        yield Row("neutral point behind c.g.", margin * chord, trimmed.unit("reference_chord"))


def control_gradients(trimmed: Trimmed) -> Iterator[Row | Lacking]:
    """Yield the changes of the pitching input per load factor and per knot."""
    pull_up = trimmed.pull_up
    if pull_up is None:
        for name in ("control per g", "CAP", "control per knot"):
            yield Lacking(name, "no input pitches the aircraft without delay")
        return
    unit = trimmed.unit(pull_up.name)
    control = pull_up.name.replace("_", " ")
    if "load_factor" not in trimmed.model.outputs:
        yield Lacking("control per g", "no output load_factor")
        yield Lacking("CAP", "no output load_factor")
    elif pull_up.load_factor:
        yield Row(f"{control} per g", 1.0 / pull_up.load_factor, f"{unit}/g", _PER_G)
    change = trimmed.change_per_knot(pull_up.name)
    if change is None:
        reason = "no trims 0.5 kt slower and faster that free the control"
        yield Lacking("control per knot", reason)
    else:
        yield Row(f"{control} per knot", change, f"{unit}/kt", _PER_KNOT)
