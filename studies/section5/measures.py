"""The numbers that claims are about, as functions of the flights that they look at."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterable, Mapping
from operator import attrgetter
from typing import Any

import numpy as np

from hfa_model.printed_matrices import published_data, published_models
from hfa_model.vectors import LINEAR_STATES
from studies.section5.claims import Evidence
from studies.section5.experiment_flights import FlightPlan, FlightRecord
from studies.section5.flown_laws import INTEGRAL
from studies.section5.metrics import FlightMetrics, over
from studies.section5.setting import CASE_I, CASE_II, Setting

#: From a setting and a law to the flights that a claim looks at.
Select = Callable[[Setting, str], tuple[FlightPlan, ...]]
Measure = Callable[[Evidence, str], float]
#: What is read of one flight: a number, or numbers by name.
Metric = Callable[[FlightMetrics], float | Mapping[str, float]]


#: Flights of a law by the name that claims give them.
FLIGHTS: dict[str, Select] = {
    "both cases": lambda setting, law: (FlightPlan(CASE_I, law), FlightPlan(CASE_II, law)),
    "5 deg": lambda setting, law: (FlightPlan(CASE_II, law),),
    "disturbance alone": lambda setting, law: tuple(
        FlightPlan(angle, law, commanded=False) for angle in (CASE_I, CASE_II)
    ),
    INTEGRAL: lambda setting, law: (FlightPlan(CASE_II, INTEGRAL),),
    "every uncertainty": lambda setting, law: tuple(
        FlightPlan(CASE_II, law, uncertainty=factor) for factor in setting.configuration.uncertainty.factors
    ),
    "noise": lambda setting, law: (FlightPlan(CASE_II, law, noise=True),),
}


def measure_of(said: str | Mapping[str, Any]) -> Measure:
    """One of `NAMED`, or {HOW = number, of = names, in = flights, to = others}, HOW worst, smallest, spread or ratio.

    number: a name of `FlightMetrics`. of: of states or inputs, all unless they are given. in, to: names of `FLIGHTS`.
    """
    if isinstance(said, str):
        return NAMED[said]
    (how,) = _TAKEN.keys() & said.keys()
    flights = [FLIGHTS[said[key]] for key in ("in", "to") if key in said]
    return _TAKEN[how](*flights, attrgetter(said[how]), of=said.get("of", ()))


def worst(select: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The largest number over the flights; of: names to look at, all when empty."""
    names = tuple(of)
    return lambda evidence, law: max(max(_numbers(one, quantity, names)) for one in _selected(evidence, select, law))


def smallest(select: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The smallest such number."""
    names = tuple(of)
    return lambda evidence, law: min(min(_numbers(one, quantity, names)) for one in _selected(evidence, select, law))


def spread(select: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The largest (largest - smallest) / largest of a number between the flights; inf when it is inf in some only.

    A number that is inf in all flights (an error that never settles, say) tells nothing and is left out; inf when
    that leaves none.
    """
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        found = []
        for values in np.array([_numbers(one, quantity, names) for one in _selected(evidence, select, law)]).T:
            if np.all(np.isfinite(values)):
                found.append(over(float(np.ptp(values)), float(values.max())) if np.ptp(values) > 0.0 else 0.0)
            elif np.any(np.isfinite(values)):
                found.append(np.inf)
        return max(found, default=np.inf)

    return measure


def ratio(select: Select, other: Select, quantity: Metric, *, of: Iterable[str] = ()) -> Measure:
    """The largest number over the same number of the other flights, flight by flight and name by name."""
    names = tuple(of)

    def measure(evidence: Evidence, law: str) -> float:
        pairs = zip(_selected(evidence, select, law), _selected(evidence, other, law), strict=True)
        return max(
            over(left, right)
            for one, two in pairs
            for left, right in zip(_numbers(one, quantity, names), _numbers(two, quantity, names), strict=True)
        )

    return measure


def gain_error(select: Select, *, at_end_of_flight: bool = False) -> Measure:
    """|K - K*| / |K*| at T_w or at the end of the flight, K of the learned value and K* of the exact solution."""

    def measure(evidence: Evidence, law: str) -> float:
        at = np.inf if at_end_of_flight else evidence.setting.configuration.predefined_time(evidence.section)
        return max(_gain_error(evidence, record, at) for record in _selected(evidence, select, law))

    return measure


def _gain_error(evidence: Evidence, record: FlightRecord, time: float) -> float:
    case = evidence.setting.case(record.plan.dihedral_deg)
    assert record.critic is not None
    row = min(int(np.searchsorted(record.times, time - 1e-9)), len(record.times) - 1)
    K = case.game.gain(record.critic.basis.matrix(record.critic.weights[row]))
    return float(np.linalg.norm(K - case.exact.K) / np.linalg.norm(case.exact.K))


def _selected(evidence: Evidence, select: Select, law: str) -> list[FlightRecord]:
    return evidence.records(*select(evidence.setting, law))


def _numbers(record: FlightRecord, quantity: Metric, names: tuple[str, ...]) -> list[float]:
    value = quantity(record.metrics)
    return [value[name] for name in names or value] if isinstance(value, Mapping) else [float(value)]


def _over_integral(measure: Measure) -> Measure:
    return lambda evidence, law: measure(evidence, law) / measure(evidence, INTEGRAL)


def _final_abscissa(evidence: Evidence, law: str) -> float:
    """Largest real part of the eigenvalues of A - B K with the gain learned last, 1/s."""
    record, game = evidence.record(FlightPlan(CASE_II, law)), evidence.setting.case(CASE_II).game
    assert record.critic is not None
    K = game.gain(record.critic.basis.matrix(record.critic.weights[-1]))
    return float(np.linalg.eigvals(game.A - game.B @ K).real.max())


def _printed_coupling(evidence: Evidence, law: str) -> float:
    """The smaller of |pitch-rate row at 5 deg| / |at 15 deg| for A and for B, as printed."""
    row = LINEAR_STATES.index("pitch_rate")
    sizes = [[np.linalg.norm(matrix[row]) for matrix in (model.A, model.B)] for model in published_models()]
    return float(min(second / first for first, second in zip(*sizes, strict=True)))


def _commanded_dihedral(evidence: Evidence, law: str) -> float:
    return float(np.degrees(evidence.setting.configuration.reference.signal.constant[LINEAR_STATES.index("dihedral")]))


def _eigenvalue_difference(evidence: Evidence, law: str) -> float:
    """Largest |λ - quoted| over the modes, each quoted magnitude against the nearest eigenvalue, 1/s."""
    eigenvalues = np.linalg.eigvals(published_models()[1].A)
    folded = np.abs(eigenvalues.real) + 1j * np.abs(eigenvalues.imag)  # the quoted signs are lost
    quoted = [_quoted(text) for text in published_data()["eigenvalues_quoted_for_5_deg"]["magnitudes"]]
    return float(max(np.abs(folded - value).min() for value in quoted))


def _quoted(text: str) -> complex:
    """ "4.82 +/- 18.66i" and "7.11" as numbers."""
    real, imaginary = re.fullmatch(r"([\d.]+)(?: \+/- ([\d.]+)i)?", text).groups()  # type: ignore[union-attr]
    return complex(float(real), float(imaginary or 0.0))


_TAKEN: dict[str, Callable[..., Measure]] = {"worst": worst, "smallest": smallest, "spread": spread, "ratio": ratio}
#: What is not a number of one flight.
NAMED: dict[str, Measure] = {
    "gain error at T_w": gain_error(FLIGHTS["both cases"]),
    "last gain error over that of integral RL": _over_integral(gain_error(FLIGHTS["5 deg"], at_end_of_flight=True)),
    "abscissa with the last gain": _final_abscissa,
    "printed pitch-rate coupling": _printed_coupling,
    "commanded dihedral": _commanded_dihedral,
    "quoted eigenvalues": _eigenvalue_difference,
}
