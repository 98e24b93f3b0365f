"""docs/experiments.md says what the committed results say, and they are those of this project's configuration."""

from __future__ import annotations

import json
import re
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from experiment_configurations import changed

from studies.section5.__main__ import main
from studies.section5.configuration import section5_configuration
from studies.section5.experiment_flights import FlightPlan, simulate_plan
from studies.section5.flown_laws import CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, MODIFIED, REWEIGHTED
from studies.section5.reproduction import EXPERIMENTS
from studies.section5.setting import make_setting
from studies.section5.tables import claims_summary

DOCS = Path(__file__).parents[3] / "docs"
RESULTS = DOCS.parent / "studies" / "section5" / "results"
OWN = (CERTIFIED, CERTIFIED_FF, EXACT, EXACT_FF, REWEIGHTED)


def results() -> dict[str, Any]:
    table: dict[str, Any] = json.loads((RESULTS / "claims.json").read_text(encoding="utf-8"))
    return table


def document() -> str:
    return (DOCS / "experiments.md").read_text(encoding="utf-8")


def sentences() -> str:
    """The document on one line, so that a line break does not hide a number."""
    return " ".join(document().split())


#: A row of the table of numbers: what, the claim, and a number for each law.
ROW = re.compile(r"^\|[^|]*\| (?:claim|5\.\d-\d+) \|.*\|$", re.M)


def rows_of(text: str) -> list[dict[str, str]]:
    """The rows of the table of numbers, by the names in its header: "claim" and the laws."""
    header, *rows = ([cell.strip() for cell in line.split("|")[2:-1]] for line in ROW.findall(text))
    return [dict(zip(header, row, strict=True)) for row in rows]


def wrong_numbers(text: str, table: dict[str, Any]) -> list[str]:
    """Cells of the table of numbers that are not those of the results."""
    claims = {claim["number"]: claim for claim in table["claims"]}
    found = []
    for row in rows_of(text):
        findings = claims[row.pop("claim")]["findings"]
        for law, cell in row.items():
            right = f"{findings[law]['value']:.3g}" if law in findings else ""
            found += [f"{law}: {cell}"] * (cell != right)
    return found


def test_the_numbers_of_the_text_are_those_of_the_results() -> None:
    assert len(rows_of(document())) >= 15
    assert wrong_numbers(document(), results()) == []


def test_every_claim_that_the_text_names_is_in_the_results() -> None:
    named = set(re.findall(r"5\.\d-\d+", document()))
    assert named == {claim["number"] for claim in results()["claims"]}


def test_a_wrong_number_is_seen() -> None:
    planted = "| | claim | exact |\n|---|---|---|\n| error | 5.1-6 | 0.5 |\n"
    assert wrong_numbers(planted, results()) == ["exact: 0.5"]
    assert wrong_numbers(planted.replace("0.5", "0.802"), results()) == []


def test_the_table_and_the_counts_are_those_of_the_results() -> None:
    table = results()
    assert claims_summary(table) in document()
    counts = ", ".join(f"{count} {verdict}" for verdict, count in table["verdicts"].items())
    assert counts in sentences()
    assert f"in all {len(table['lost_flights'])} flights" in sentences()


def test_the_results_are_those_of_this_configuration() -> None:
    """Committed results grow stale when the configuration or a claim changes: run `hfa reproduce all` and copy them."""
    table, setting = results(), make_setting(section5_configuration())
    assert table["setting"]["reading"] == setting.identity["reading"]
    assert table["setting"]["matrices"] == "regenerated"
    for stored, model in zip(table["setting"]["models"], setting.identity["models"], strict=True):
        np.testing.assert_allclose(stored["A"], model["A"], rtol=1e-9, atol=1e-9)
        np.testing.assert_allclose(stored["B"], model["B"], rtol=1e-9, atol=1e-9)
    asked = [(claim["number"], claim["says"], claim["measured"], claim["relation"]) for claim in table["claims"]]
    assert asked == [
        (claim.number, claim.says, claim.what, claim.relation) for one in EXPERIMENTS.values() for claim in one.claims
    ]


def test_the_committed_results_are_small() -> None:
    assert sum(path.stat().st_size for path in RESULTS.iterdir()) < 1_000_000


@pytest.mark.slow
def test_the_results_come_out_again(tmp_path: Path) -> None:
    """Our own laws to 1e-6 on any processor; the paper's chatters at rounding, but its verdicts stand."""
    assert main(["-o", str(tmp_path / "out")]) == 0
    again = json.loads((tmp_path / "out" / "claims.json").read_text(encoding="utf-8"))
    assert again["verdicts"] == results()["verdicts"]
    for stored, found in zip(results()["claims"], again["claims"], strict=True):
        assert stored["verdict"] == found["verdict"], stored["number"]
        for law in OWN:
            if law in stored["findings"]:
                one, other = stored["findings"][law]["value"], found["findings"][law]["value"]
                assert one == other or other == pytest.approx(one, rel=1e-6, abs=1e-9), (stored["number"], law)


@pytest.mark.slow
def test_the_modifications_are_what_keeps_the_published_law_bounded() -> None:
    """Every stack tried is simulated to its end; with fourth powers in the basis some are lost."""
    held = {"quadratic": 0, "paper": 0}
    for name in held:
        for seed in (0, 2, 3):
            setting = make_setting(changed({"published_modified": {"basis": name}, "critic": {"seed": seed}}))
            held[name] += sum(simulate_plan(setting, FlightPlan(angle, MODIFIED), "5.1").held for angle in (15.0, 5.0))
    assert held["quadratic"] == 6
    assert held["paper"] < 6
