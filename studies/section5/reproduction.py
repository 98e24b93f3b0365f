"""All of Section 5: which experiments there are, how one is run, and the table of claims."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Any

from hfa_model.provenance import Provenance
from hfa_support.errors import refuse_unknown
from hfa_support.jobs.workers import workers
from hfa_support.jsonable import jsonable
from hfa_support.progress import Progress
from studies.section5.claims import CONFIRMED, NOT_CONFIRMED, NOT_DECIDABLE, Evidence, check_claim
from studies.section5.experiment_flights import FlightRecord, simulate_plan
from studies.section5.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, LAWS, REWEIGHTED
from studies.section5.result_folder import finished_experiment, write_outcome
from studies.section5.sections import EXPERIMENTS, Experiment, Outcome
from studies.section5.setting import Setting

SCHEMA = "hfa.claims/1"
ALL = "all"
#: Laws of this project: a flight of theirs that is lost is an error of the project, not a finding about the paper.
_OWN = (CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, REWEIGHTED)


def experiments(name: str) -> tuple[Experiment, ...]:
    """The experiment of a section, or all of them. Raises BadInputError for another name."""
    if name == ALL:
        return tuple(EXPERIMENTS.values())
    refuse_unknown("there is no experiment", name, (*EXPERIMENTS, ALL))
    return (EXPERIMENTS[name],)


def run_experiment(
    experiment: Experiment, setting: Setting, progress: Progress | None = None, processes: int = 1
) -> Outcome:
    """Simulate every flight and check every claim. processes: that share the flights."""
    plans = experiment.flights(setting)
    told = progress or (lambda *_: None)
    records: dict[int, FlightRecord] = {}
    told(0, len(plans), experiment.section)
    with workers(processes) as run_on:
        for key, record in run_on(simulate_plan, enumerate((setting, plan, experiment.section) for plan in plans)):
            records[key] = record
            told(len(records), len(plans), experiment.section)
    flown = {plan: records[key] for key, plan in enumerate(plans)}
    evidence = Evidence(setting, experiment.section, flown)
    return Outcome(experiment, setting, flown, tuple(check_claim(claim, evidence) for claim in experiment.claims))


def reproduce(
    chosen: Sequence[Experiment],
    setting: Setting,
    folder: Path,
    origin: Provenance,
    *,
    resume: bool = False,
    progress: Progress | None = None,
    processes: int = 1,
) -> dict[str, Any]:
    """Run experiments into folder/section each, and return the table of their claims.

    resume: an experiment that is there with the same identity is not run again. processes: that share the flights.
    """
    results = []
    for experiment in chosen:
        known = finished_experiment(experiment, setting, folder) if resume else None
        results.append(known or write_outcome(run_experiment(experiment, setting, progress, processes), folder, origin))
    return claims_table(setting, results) | {"provenance": origin.to_dict()}


def claims_table(setting: Setting, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """The claims of several experiments with counts of the verdicts, and the simulated flights."""
    claims = [claim for result in results for claim in result["claims"]]
    verdicts = [claim["verdict"] for claim in claims]
    used = {law for result in results for law in result["laws"]}
    table = {
        "schema": SCHEMA,
        "setting": setting.identity,
        "laws": {law: text for law, text in LAWS.items() if law in used},
        "verdicts": {verdict: verdicts.count(verdict) for verdict in (CONFIRMED, NOT_CONFIRMED, NOT_DECIDABLE)},
        "lost_flights": lost_flights(results),
        "own_failures": own_failures(results),
        "claims": claims,
        "experiments": [
            {key: result[key] for key in ("section", "title", "identity", "flights", "pictures")} for result in results
        ],
    }
    whole: dict[str, Any] = jsonable(table)
    return whole


def lost_flights(results: Sequence[dict[str, Any]]) -> list[dict[str, Any]]:
    """Section, name, law and time of every flight that did not come to its end."""
    return [
        {
            "section": result["section"],
            "name": flight["name"],
            "law": flight["law"],
            "lost_at": flight["metrics"]["lost_at"],
        }
        for result in results
        for flight in result["flights"]
        if flight["metrics"]["lost_at"] is not None
    ]


def own_failures(results: Sequence[dict[str, Any]]) -> list[str]:
    """Flights of this project's own laws that were lost, or whose learning was not certified."""
    found = []
    for result in results:
        for flight in result["flights"]:
            status = flight["metrics"].get("learning", {}).get("facts", {}).get("status", "converged")
            if flight["law"] in _OWN and (flight["metrics"]["lost_at"] is not None or status != "converged"):
                found.append(f"{result['section']}: {flight['name']}")
    return found
