"""Simulate Section 5 of the paper: figures 3 to 23 and every numerical claim, for each control law.

The study takes a minute and a half of processor time. It writes FOLDER/SECTION/ with figure-NN.png,
figure-NN.npz and result.json, and FOLDER/claims.json and claims.md. A claim that is not confirmed
is a result, not a failure.
"""

from __future__ import annotations

import argparse
import multiprocessing
import os
import shlex
import sys
import zipfile
import zlib
from collections.abc import Mapping, Sequence
from concurrent.futures import ProcessPoolExecutor
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
from matplotlib.image import imread

from hfa import BadInputError, NoSolutionError
from hfa.page.claims import SCHEMA, claims_table as shown_claims
from hfa.paper import default_parameters
from hfa_support.files import write_text
from hfa_support.provenance import Provenance, parameter_hash
from hfa_support.reporting.data_files import json_text, jsonable
from hfa_support.reporting.figure import save
from hfa_support.reporting.markup import markdown_table
from hfa_support.reporting.text import Table
from studies.finished import finished, stamped
from studies.section5.claims import VERDICTS, Evidence, check_claim, claims_of, plans_of
from studies.section5.configuration import SECTIONS, section5_configuration
from studies.section5.figures import draw, figures_of
from studies.section5.flights import LAWS, MATRICES, OWN, Setting, make_setting, simulate_plan

_LEARNING = "Comparison with integral reinforcement learning"
_TITLES = ("Different trim points", _LEARNING, "Model uncertainty", "Measurement noise")


def main(argv: Sequence[str] | None = None) -> int:
    """Run the study and return the exit code.

    - 0: no flight under a law of this project failed
    - 1: a flight under a law of this project failed, or there is no solution
    - 2: bad input
    """
    parser = argparse.ArgumentParser("python -m studies.section5", description=__doc__)
    parser.add_argument(
        "section", nargs="?", default="all", choices=("all", *SECTIONS), help="default: all"
    )
    parser.add_argument(
        "-o", type=Path, default=Path("out/section5"), metavar="FOLDER", help="default: %(default)s"
    )
    about = (
        "source of A and B: trimmed and linearized here (default), or printed with four decimals"
    )
    parser.add_argument("--matrices", choices=MATRICES, default=MATRICES[0], help=about)
    parser.add_argument("--resume", action="store_true", help="reuse finished sections in FOLDER")
    parser.add_argument(
        "--workers", type=int, default=os.cpu_count(), metavar="N", help="default: one per core"
    )
    chosen = parser.parse_args(argv)
    sections = SECTIONS if chosen.section == "all" else (chosen.section,)
    command = shlex.join(
        ["python", "-m", "studies.section5", *(sys.argv[1:] if argv is None else argv)]
    )
    aircraft = default_parameters()
    origin = Provenance(command, "published", aircraft.name, parameter_hash(aircraft.values))
    try:
        setting = make_setting(section5_configuration(), chosen.matrices)
        table = reproduce(sections, setting, chosen.o, origin, chosen.resume, chosen.workers)
    except (BadInputError, NoSolutionError) as error:
        print(f"section5: {error}", file=sys.stderr)
        return 2 if isinstance(error, BadInputError) else 1
    lines = [
        f"{claim['number']:<8}{claim['verdict']:<32}{claim['says']}" for claim in table["claims"]
    ]
    print(
        *lines,
        "",
        counts_text(table),
        *(f"failed: {name}" for name in table["own_failures"]),
        sep="\n",
    )
    return 1 if table["own_failures"] else 0


def run_section(section: str, setting: Setting, processes: int = 1) -> Evidence:
    """Return the records of all flights of a section, simulated in one or several processes."""
    plans = plans_of(section, setting)
    fly = partial(simulate_plan, setting, section=section)
    if processes == 1:
        return Evidence(setting, section, {plan: fly(plan) for plan in plans})
    # A forked process would inherit the threads of CasADi and NumPy in an invalid state.
    with ProcessPoolExecutor(processes, multiprocessing.get_context("spawn")) as pool:
        return Evidence(setting, section, dict(zip(plans, pool.map(fly, plans), strict=True)))


def reproduce(
    sections: Sequence[str],
    setting: Setting,
    folder: Path,
    origin: Provenance,
    resume: bool,
    processes: int,
) -> dict[str, Any]:
    """Simulate sections of the paper, write their results and the table of claims, and return the
    table.

    folder: output folder, in which each section has a folder
    origin: provenance of the results
    resume: whether to reuse complete results of this version with the same settings
    processes: number of processes
    """
    results = []
    for section in sections:
        place = folder / section
        decides = deciding(section, setting)
        known = finished(place / "result.json", decides) if resume else None
        if known is None or not _has_pictures(place, known["pictures"]):
            print(
                f"section5: {section}, {len(plans_of(section, setting))} flights", file=sys.stderr
            )
            known = write_section(run_section(section, setting, processes), place, origin)
        results.append(known)
    table = claims_table(setting, results) | {"provenance": origin.to_dict()}
    write_text(folder / "claims.json", json_text(table))
    write_text(
        folder / "claims.md",
        f"{claims_markdown(table['claims'])}\n\n{counts_text(table)}\n\n{origin.text()}\n",
    )
    return table


def _has_pictures(place: Path, names: Sequence[str]) -> bool:
    """Return whether the .png and .npz files of each figure in a folder are complete."""
    try:
        for name in names:
            imread(place / f"{name}.png")
            with zipfile.ZipFile(place / f"{name}.npz") as arrays:
                if arrays.testzip() is not None:
                    return False
    except (
        OSError,
        SyntaxError,
        zipfile.BadZipFile,
        zlib.error,
    ):  # Pillow raises SyntaxError for a damaged PNG
        return False
    return True


def deciding(section: str, setting: Setting) -> dict[str, Any]:
    """Return everything that determines the results of a section: setting, flights and claims."""
    return {
        "schema": "hfa.experiment/1",
        "section": section,
        "setting": setting.identity,
        "flights": [vars(plan) for plan in plans_of(section, setting)],
        "claims": [
            [claim.number, claim.measured, claim.relation, claim.limit]
            for claim in claims_of(section)
        ],
    }


def write_section(evidence: Evidence, place: Path, origin: Provenance) -> dict[str, Any]:
    """Write the pictures and then the result of a section, and return the result.

    The result is written last. If it exists, the pictures are complete.
    """
    setting = evidence.setting
    section = evidence.section
    flown = evidence.flown
    place.mkdir(parents=True, exist_ok=True)
    (place / "result.json").unlink(missing_ok=True)
    pictures = list(figures_of(section, setting.configuration, flown))
    for picture in pictures:
        path = place / f"figure-{picture.number:02d}"
        arrays: dict[str, Any] = picture.arrays
        np.savez_compressed(path.with_suffix(".npz"), **arrays)
        save(draw(picture), path.with_suffix(".png"), origin.text())
    content = {
        "schema": "hfa.experiment/1",
        "section": section,
        "title": _TITLES[SECTIONS.index(section)],
        "matrices": setting.matrices,
        "laws": {law: LAWS[law] for law in dict.fromkeys(plan.law for plan in flown)},
        "flights": [
            {
                "name": plan.name,
                **vars(plan),
                "learned_from": record.learned_from,
                "metrics": record.metrics,
            }
            for plan, record in flown.items()
        ],
        "claims": [check_claim(claim, evidence) for claim in claims_of(section)],
        "pictures": [f"figure-{picture.number:02d}" for picture in pictures],
        "provenance": origin.to_dict(),
    }
    result = stamped(content, deciding(section, setting))
    write_text(place / "result.json", json_text(result))
    return result


def claims_table(setting: Setting, results: Sequence[dict[str, Any]]) -> dict[str, Any]:
    """Return the table of claims of several sections.

    The table contains the claims, the number of claims with each verdict, and

    - lost_flights: flights that left the envelope
    - own_failures: flights for which `_failed` is true

    results: results of the sections, as `write_section` returns them
    """
    claims = [claim for result in results for claim in result["claims"]]
    verdicts = [claim["verdict"] for claim in claims]
    used = {law for result in results for law in result["laws"]}
    flights = [(result["section"], flight) for result in results for flight in result["flights"]]
    kept = ("section", "title", "identity", "flights", "pictures")
    lost = [
        {
            "section": section,
            "name": flight["name"],
            "law": flight["law"],
            "lost_at": flight["metrics"]["lost_at"],
        }
        for section, flight in flights
        if flight["metrics"]["lost_at"] is not None
    ]
    failures = [f"{section}: {flight['name']}" for section, flight in flights if _failed(flight)]
    table: dict[str, Any] = jsonable(
        {
            "schema": SCHEMA,
            "setting": setting.identity,
            "laws": {law: text for law, text in LAWS.items() if law in used},
            "verdicts": {verdict: verdicts.count(verdict) for verdict in VERDICTS},
            "lost_flights": lost,
            "own_failures": failures,
            "claims": claims,
            "experiments": [{key: result[key] for key in kept} for result in results],
        }
    )
    return table


def _failed(flight: Mapping[str, Any]) -> bool:
    """Return whether a flight under a law of this project failed."""
    if flight["law"] not in OWN:
        return False
    facts = flight["metrics"].get("learning", {}).get("facts", {})
    return flight["metrics"]["lost_at"] is not None or not facts.get("certified", True)


def counts_text(table: Mapping[str, Any]) -> str:
    """Return one line with the number of claims for each verdict.

    If flights left the envelope, their number and their laws are added.
    """
    counts = ", ".join(f"{count} {verdict}" for verdict, count in table["verdicts"].items())
    laws = "; ".join(sorted({flight["law"] for flight in table["lost_flights"]}))
    return f"{counts}; {len(table['lost_flights'])} flights were lost ({laws})" if laws else counts


def claims_markdown(claims: Sequence[dict[str, Any]]) -> str:
    """Return the table of claims as Markdown. A number that satisfies its claim is bold."""
    shown = shown_claims(claims)
    bold = [
        tuple(f"**{cell}**" if getattr(cell, "tone", "") == "good" else cell for cell in row)
        for row in shown.rows
    ]
    return markdown_table(Table(shown.header, bold))


if __name__ == "__main__":
    sys.exit(main())
