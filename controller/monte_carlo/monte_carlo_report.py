"""What a Monte Carlo says in short; the members are in the store."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from controller.flight.envelope import ANGLE_OF_ATTACK, OVER_GROUND, limited_names
from controller.flight.uncertain import Uncertainty
from controller.monte_carlo.monte_carlo_plan import MonteCarlo
from hfa_model.vectors import INPUTS, LINEAR_STATES, UNITS
from hfa_support.jobs.store import Store
from hfa_support.reporting.report import Report, Reported
from hfa_support.reporting.text import Table, short_number, shown_unit

SCHEMA = "hfa.monte-carlo-summary/1"
#: Shares of the members that held, up to which a quantity stays below its quantile.
QUANTILES = (0.05, 0.5, 0.95, 1.0)
_SHOWN = (("rms_error", LINEAR_STATES), ("peak_error", LINEAR_STATES), ("effort", INPUTS))


class DrawnError(NamedTuple):
    """Relative standard deviation of a parameter as asked for; mean and deviation of its factor as drawn."""

    asked: float
    mean: float
    deviation: float | None


@dataclass(frozen=True, eq=False, repr=False)
class MonteCarloResult(Reported):
    """Members that held, and that left by the state that left first, the earliest after `first_left` s.

    quantiles: quantity -> variable -> `QUANTILES` over those that held; None where none did.
    """

    plan: MonteCarlo
    held: int
    left: Mapping[str, int]
    first_left: float | None
    quantiles: Mapping[str, Mapping[str, list[float] | None]]
    errors: Mapping[str, DrawnError]
    where: str = ""

    @classmethod
    def of(cls, plan: MonteCarlo, store: Store, where: str = "") -> MonteCarloResult:
        """From the members in a store. where: what the report says about where they are."""
        left, flown, factors = store.read("left"), store.read("flown"), store.read("factors")
        held, moving_air = left < 0, plan.scenario.moving_air
        return cls(
            plan,
            held=int(held.sum()),
            left={name: int((left == index).sum()) for index, name in enumerate(limited_names(moving_air))},
            first_left=None if held.all() else float(flown[~held].min()),
            quantiles={
                **{name: _quantiles(store.read(name)[held], of) for name, of in _SHOWN},
                "peak_deviation": _quantiles(store.read("peak_angle_of_attack")[held, None], (ANGLE_OF_ATTACK,)),
            },
            errors={
                name: DrawnError(asked, float(drawn.mean()), float(drawn.std(ddof=1)) if plan.members > 1 else None)
                for (name, asked), drawn in zip(plan.scenario.uncertainty.errors.items(), factors.T, strict=True)
            },
            where=where,
        )

    def report(self) -> Report:
        """Angles in degrees for people; data in English units and radians, None where no member counts."""
        plan, duration = self.plan, self.plan.scenario.duration
        title = (
            f"Monte Carlo, {plan.dynamics} dynamics, {plan.plant} aircraft, law {plan.law.name}: "
            f"{plan.members} members of {duration:g} s, seed {plan.seed}" + (f", {self.where}" if self.where else "")
        )
        outcome = f"held their envelope: {self.held} of {plan.members}"
        if self.first_left is not None:
            gone = ", ".join(f"{name} {count}" for name, count in self.left.items() if count)
            outcome += f"\nleft it, by the state that left first: {gone}; the first after {self.first_left:.3g} s"
        parts: list[str | Table] = [outcome]
        if self.held:
            moving = plan.scenario.moving_air
            parts.append(_quantile_table({k: v for k, v in self.quantiles.items() if moving or k != "peak_deviation"}))
            parts += [OVER_GROUND] if moving else []
        if self.errors:
            rows = [
                (name, *("-" if value is None else f"{value:.4g}" for value in drawn))
                for name, drawn in self.errors.items()
            ]
            parts.append(Table(("parameter", "relative deviation", "drawn mean", "drawn deviation"), rows))
        data = {
            "schema": SCHEMA,
            "dynamics": plan.dynamics,
            "plant": plan.plant,
            "law": plan.law.name,
            "members": plan.members,
            "seed": plan.seed,
            "duration": duration,
            "held": self.held,
            "left": self.left,
            "first_left": self.first_left,
            "quantiles": list(QUANTILES),
            **self.quantiles,
            "errors": {name: drawn._asdict() for name, drawn in self.errors.items()},
        }
        alike = plan.scenario.uncertainty == Uncertainty()
        notes = ["nothing differs from member to member: give parameter errors, noise or turbulence"] if alike else []
        return Report(title, parts, notes, data)


def _quantiles(values: np.ndarray, names: tuple[str, ...]) -> Mapping[str, list[float] | None]:
    if not len(values):
        return dict.fromkeys(names)
    return dict(zip(names, np.quantile(values, QUANTILES, axis=0).T.tolist(), strict=True))


def _quantile_table(quantiles: Mapping[str, Mapping[str, list[float] | None]]) -> Table:
    rows = [
        (
            f"{quantity.replace('_', ' ')} {name}",
            *(short_number(value, UNITS[name]) for value in values or ()),
            shown_unit(UNITS[name]),
        )
        for quantity, found in quantiles.items()
        for name, values in found.items()
    ]
    shares = ["largest" if share == 1.0 else f"{100 * share:g} %" for share in QUANTILES]
    return Table(("of those that held", *shares, "unit"), rows)
