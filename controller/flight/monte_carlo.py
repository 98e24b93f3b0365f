"""A Monte Carlo of flights: a plan of random scenarios, its members in chunks into a store, and
their report."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Mapping
from dataclasses import asdict, dataclass
from functools import cached_property
from typing import Any

import casadi as ca
import numpy as np

from controller.flight.air import (
    ALPHA,
    ANGLE_OF_ATTACK,
    OVER_GROUND,
    flown_through_air,
    limited_names,
)
from controller.flight.closed_loop import ClosedLoop, NonlinearPlant
from controller.flight.envelope import control_limits, envelope_data, refuse_start
from controller.flight.nonlinear_flight import NonlinearFlight, fly_within, names_and_units
from controller.flight.policies import Policy
from controller.flight.scenario import Scenario, Uncertainty, with_errors
from controller.flight.signals import CommandedStates, Waveform
from controller.flight.simulation import CompiledLoop
from hfa_aircraft.model import VECTORS, Model, components
from hfa_support.errors import BadInputError
from hfa_support.jobs.store import Array, Layout, Store, described
from hfa_support.native.bound import cached_per_thread
from hfa_support.reporting.fields import Shown
from hfa_support.reporting.report import Report
from hfa_support.reporting.text import Table, short_number, shown_unit
from trim.limits import Limits
from trim.point.operating_point import OperatingPoint

STORE_SCHEMA, SUMMARY_SCHEMA = "hfa.monte-carlo-store/1", "hfa.monte-carlo-summary/1"
#: Steps of a chunk: at 0.8 µs a step and more, half a second of work or more.
CHUNK_STEPS = 1_000_000
#: Shares of the members inside their envelope up to which a quantity stays below its quantile.
QUANTILES = (0.05, 0.5, 0.95, 1.0)

#: Array of a store, of each member -> its meaning, and its axis or, of one number, its unit.
_KEPT = {
    "left": ("number in the attribute left; -1: stayed inside", ""),
    "cycle": (
        "number among inputs and states of what still oscillates at the end; -1: nothing",
        "",
    ),
    "factors": ("factor on a parameter", "error"),
    "flown": ("time inside the envelope", "s"),
    "rms_error": ("root mean square error over that time, without noise", "error_state"),
    "peak_error": ("largest error, over ground", "error_state"),
    "peak_angle_of_attack": ("largest angle of attack through the air, from trim", "rad"),
    "effort": ("root mean square from trim", "input"),
    "lowest_input": ("lowest value inside the envelope", "input"),
    "highest_input": ("highest value inside the envelope", "input"),
    "final": ("at the end", "state"),
    "memory": ("memory of the policy at the end", "memory_state"),
}


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarlo(Shown):
    """N members, each a draw of one scenario: a job of `stream`. Two plans are equal when they give
    the same results.

    members: N
    seed: with the number of a member it decides all that is random in it, so that members can be
        simulated anywhere in any order
    model: with its nominal parameters
    point: its trim, in which each member begins
    policy: what acts
    scenario: what happens, of which each member is a draw
    envelope: limits of the states; a member's flight ends at the first tick outside

    BadInputError when a number is wrong, the flight does not begin inside its envelope, an error
    belongs to a parameter that is zero, or a signal has no formula.
    """

    members: int
    seed: int
    model: Model
    point: OperatingPoint
    policy: Policy
    scenario: Scenario
    envelope: Limits

    def __post_init__(self) -> None:
        """Check everything before the simulation."""
        if not (self.members >= 1 and self.seed >= 0):
            raise BadInputError(
                f"members is {self.members} and seed {self.seed}; give at least 1 and 0"
            )
        object.__setattr__(self, "scenario", self.scenario.on(self.model))
        for name in ("reference", "disturbance", "noise"):
            if not isinstance(getattr(self.scenario, name), (Waveform, CommandedStates)):
                raise BadInputError(
                    f"the {name} of a Monte Carlo must be a Waveform, whose formula says what it is"
                )
        if self.scenario.samples is not None:
            raise BadInputError(
                "the scenario of a Monte Carlo is drawn already; give the one that it was drawn from"
            )
        refuse_start(self.envelope, np.array(self.point.states) + self.scenario.initial)
        for name in self.scenario.uncertainty.errors:
            if self.model.parameters[name].start == 0.0:
                raise BadInputError(
                    f"{name} is 0, so that a relative error does nothing; leave it out"
                )
        self.loop()  # turbulence and gains that cannot be flown are refused here rather than in a worker

    def member(self, number: int) -> Scenario:
        """What happens in one member; turbulence is met at the trimmed speed."""
        return self.scenario.drawn(self.seed, number, self.point)

    def loop(self) -> ClosedLoop:
        """The loop of member 0. The parameters of the aircraft differ from member to member."""
        plant = NonlinearPlant(self.model, self.point, uncertain=True)
        return ClosedLoop(plant, self.policy, self.member(0))

    @cached_property
    def identity(self) -> str:
        """JSON of everything that decides the results, the order in which errors are drawn
        included."""
        data = {
            "members": self.members,
            "seed": self.seed,
            "parameters": {name: each.start for name, each in self.model.parameters.items()},
            "dynamics": self.model.name,
            "model": _told_apart(self.model),
            "states": self.point.states._asdict(),
            "inputs": self.point.inputs._asdict(),
            "law": {"name": self.policy.name, **self.policy.identity},
            "scenario": self.scenario.to_dict(),
            "uncertainty": asdict(self.scenario.uncertainty),
            "envelope": envelope_data(self.envelope, self.scenario.moving_air),
        }
        return json.dumps(data, default=lambda value: np.asarray(value).tolist())

    @property
    def layout(self) -> Layout:
        """One row a member."""
        model = self.model
        axes = {
            "error": tuple(self.scenario.uncertainty.errors),
            "error_state": model.linear,
            "state": tuple(model.states),
            "input": tuple(model.inputs),
        }
        units = {axis: model.units(names) for axis, names in axes.items() if axis != "error"}
        sizes = {axis: len(names) for axis, names in axes.items()} | {
            "memory_state": len(self.policy.start)
        }
        arrays = {}
        for name, (meaning, axis) in _KEPT.items():
            kind, fill = ("int8", -1) if name in ("left", "cycle") else ("float64", np.nan)
            about = described(
                meaning, "" if axis in sizes else axis, f"{axis}_unit" if axis in units else ""
            )
            own = (axis,) if axis in sizes else ()
            arrays[name] = Array(tuple(sizes[each] for each in own), kind, fill, own, about)
        labels: dict[str, Any] = {axis: (axis, names) for axis, names in axes.items()}
        labels |= {f"{axis}_unit": (axis, each) for axis, each in units.items()}
        attributes = {
            "coordinates": " ".join(f"{axis}_unit" for axis in units),
            "errors": list(axes["error"]),
            "left": list(limited_names(model, self.scenario.moving_air)),
            "error_states": list(model.linear),
            "error_units": list(model.units(model.linear)),
            **names_and_units(model),
        }
        chunk = -(-CHUNK_STEPS // (self.scenario.ticks * self.scenario.steps_per_tick))
        plan, rows = json.loads(self.identity), self.members
        return Layout(
            STORE_SCHEMA, "Monte Carlo", rows, "member", chunk, plan, arrays, labels, attributes
        )

    @property
    def function(self) -> Callable[..., Mapping[str, np.ndarray]]:
        """What workers run."""
        return fly_members

    def task(self, start: int, stop: int) -> tuple[MonteCarlo, int, int]:
        """The plan and the numbers of the members."""
        return self, start, stop

    def __eq__(self, other: object) -> bool:
        return isinstance(other, MonteCarlo) and self.identity == other.identity

    def __hash__(self) -> int:
        return hash(self.identity)


def _told_apart(model: Model) -> tuple[str, ...]:
    """What decides a model's equations: the file that it comes from and its hash, else a hash of
    the expressions."""
    if model.source[0]:
        return model.source
    vectors = model.layout.symbols(*VECTORS)
    *given, w = map(components, vectors)
    rates = model.layout.expressions(given, (), w)[0]
    return (hashlib.sha256(ca.Function("f", vectors, [rates]).serialize().encode()).hexdigest(),)


@cached_per_thread(maxsize=4)
def member_loop(plan: MonteCarlo) -> CompiledLoop:
    """The loop of a plan, compiled at the first call in a thread."""
    return CompiledLoop(plan.loop(), plan.members)


def fly_member(plan: MonteCarlo, member: int) -> NonlinearFlight:
    """Draw and simulate one member."""
    scenario = plan.member(member)
    parameters = with_errors(plan.model, scenario).p
    return fly_within(member_loop(plan), plan.envelope, scenario, parameters)


def fly_members(plan: MonteCarlo, start: int, stop: int) -> Mapping[str, np.ndarray]:
    """The rows of `_KEPT` of members start .. stop - 1. What a worker runs."""
    rows = [member_row(plan, fly_member(plan, member)) for member in range(start, stop)]
    return {name: np.array([row[name] for row in rows]) for name in _KEPT}


def member_row(plan: MonteCarlo, result: NonlinearFlight) -> dict[str, Any]:
    """What is kept of the flight of a member: of its steps inside the envelope, and the state and
    memory after them."""
    model, scenario, flight, left = (
        plan.model,
        result.loop.scenario,
        result.flight,
        result.departure,
    )
    flown = scenario.duration if left is None else left.time
    inside = slice(round(flown / scenario.step))  # none where turbulence is outside at the start
    errors, inputs, states = flight.errors[inside], flight.inputs[inside], list(model.states)
    angles = flight.limited[inside, states.index(ALPHA)] if ALPHA in states else np.zeros(0)
    names, moving = (*model.inputs, *model.states), scenario.moving_air
    return {
        "left": -1 if left is None else limited_names(model, moving).index(left.state),
        "cycle": -1 if result.cycle is None else names.index(result.cycle.name),
        "factors": [scenario.errors[name] for name in plan.scenario.uncertainty.errors],
        "flown": flown,
        "rms_error": np.sqrt(np.square(errors).sum(axis=0) / max(len(errors), 1)),
        "peak_error": np.abs(errors).max(axis=0, initial=0.0),
        "peak_angle_of_attack": np.abs(angles).max(initial=0.0),
        "effort": np.sqrt(np.square(inputs).sum(axis=0) / max(len(inputs), 1)),
        "lowest_input": inputs.min(axis=0, initial=np.inf) + np.array(plan.point.inputs),
        "highest_input": inputs.max(axis=0, initial=-np.inf) + np.array(plan.point.inputs),
        "final": result.states[inside.stop],
        "memory": flight.memory[inside.stop],
    }


def member_report(plan: MonteCarlo, store: Store, where: str = "") -> Report:
    """How many of the members in a store stayed within their limits, and what the others did;
    where: they are kept.

    Angles in degrees for people; data in English units and radians. data: held, members that did
    not leave their envelope; within_limits: those of them whose inputs stayed within the control
    limits and that settle; left: members by the state that left first, the earliest after
    `first_left` s; exceeded: by the input that went beyond its control limit; limit_cycle: by what
    still oscillates at the end; quantity -> variable -> `QUANTILES` over those inside, None where
    none was."""
    model, duration, moving = plan.model, plan.scenario.duration, plan.scenario.moving_air
    left, flown, cycle = store.read("left"), store.read("flown"), store.read("cycle")
    inside, names = left < 0, limited_names(model, moving)
    limits = control_limits(model)
    beyond = ~(
        limits.within(store.read("lowest_input")) & limits.within(store.read("highest_input"))
    )
    within = int((inside & ~beyond.any(axis=1) & (cycle < 0)).sum())
    first = None if inside.all() else float(flown[~inside].min())
    counts = {
        "left": {name: int((left == index).sum()) for index, name in enumerate(names)},
        "exceeded": dict(zip(model.inputs, beyond.sum(axis=0).tolist(), strict=True)),
        "limit_cycle": {
            name: int((cycle == index).sum())
            for index, name in enumerate((*model.inputs, *model.states))
        },
    }
    lines = [f"stayed within limits: {within} of {plan.members}"]
    for name, words in (
        ("left", "left the envelope, by the state that left first"),
        ("exceeded", "exceeded control limits"),
        ("limit_cycle", "limit cycle that does not decay"),
    ):
        if any(counts[name].values()):
            listed = ", ".join(f"{each} {count}" for each, count in counts[name].items() if count)
            lines.append(
                f"{words}: {listed}"
                + (f"; the first after {first:.3g} s" if name == "left" else "")
            )
    parts: list[str | Table] = ["\n".join(lines)]
    quantiles, table = _quantiles(plan, store, inside)
    if inside.any():
        parts += [table, *[OVER_GROUND] * (moving and flown_through_air(model))]
    title = (
        f"Monte Carlo, {plan.point.called}, nonlinear aircraft, law {plan.policy.name}: "
        f"{plan.members} members of {duration:g} s, seed {plan.seed}"
        + (f", {where}" if where else "")
    )
    data = {
        "schema": SUMMARY_SCHEMA,
        "dynamics": model.name,
        "plant": "nonlinear",
        "law": plan.policy.name,
        "members": plan.members,
        "seed": plan.seed,
        "duration": duration,
        "within_limits": within,
        "held": int(inside.sum()),
        "first_left": first,
        **counts,
        "quantiles": list(QUANTILES),
        **quantiles,
    }
    alike = plan.scenario.uncertainty == Uncertainty()
    notes = (
        ["nothing differs from member to member: give parameter errors, noise or turbulence"]
        if alike
        else []
    )
    return Report(title, parts, notes, data)


def _quantiles(plan: MonteCarlo, store: Store, inside: np.ndarray) -> tuple[dict[str, Any], Table]:
    """Quantity -> variable -> its `QUANTILES` over the members inside; the same as a table."""
    model, rows, found = plan.model, list[tuple[str, ...]](), dict[str, Any]()
    kept = {"rms_error": model.linear, "peak_error": model.linear, "effort": tuple(model.inputs)}
    if flown_through_air(model):
        kept["peak_deviation"] = (ANGLE_OF_ATTACK,)
    for name, of in kept.items():
        values = store.read("peak_angle_of_attack" if name == "peak_deviation" else name)[
            inside
        ].reshape(-1, len(of))
        ends = (
            np.quantile(values, QUANTILES, axis=0).T.tolist() if inside.any() else [None] * len(of)
        )
        found[name] = dict(zip(of, ends, strict=True))
        for each, numbers in zip(of, ends, strict=True):
            if plan.scenario.moving_air or name != "peak_deviation":
                cells = (short_number(number, model.unit(each)) for number in numbers or ())
                rows.append(
                    (f"{name.replace('_', ' ')} {each}", *cells, shown_unit(model.unit(each)))
                )
    shares = ["largest" if share == 1.0 else f"{100 * share:g} %" for share in QUANTILES]
    return found, Table(("of those inside the envelope", *shares, "unit"), rows)
