"""What README and docs/scaling.md say of the benchmarks is what was stored, and what was stored holds together."""

from __future__ import annotations

import json

import pytest
from import_graph import ROOT

from benchmarks import report
from benchmarks.documents import HEADLINES, arithmetic, documented
from benchmarks.jobs_size import growth
from benchmarks.report import Row, Size
from benchmarks.timing import Comparison

SCALING = "docs/scaling.md"


def complaints_about(texts: dict[str, str], data: dict) -> list[str]:
    found = [
        f"{name} does not show the stored figures: paste `python -m benchmarks.documents`"
        for name, parts in documented(data).items()
        if not all(part in texts[name] for part in parts)
    ]
    missed = [figure["job"] for figure in data["figures"] if figure["reached"] == "NO"]
    return found + [f"{SCALING} does not explain {job!r}" for job in missed if f'"{job}"' not in texts[SCALING]]


def documents() -> dict[str, str]:
    return {name: (ROOT / name).read_text("utf-8") for name in ("README.md", SCALING)}


def test_documents_show_the_stored_figures() -> None:
    assert complaints_about(documents(), report.stored()) == []
    assert "pictures/benchmarks.png" in documents()[SCALING]


def test_the_readme_shows_one_row_for_each_headline() -> None:
    (table,) = documented(report.stored())["README.md"]
    assert len(table.splitlines()) == 2 + len(HEADLINES)


def test_documents_of_other_figures_would_be_noticed() -> None:
    changed = json.loads(json.dumps(report.stored()))
    for figure in changed["figures"]:
        figure["ratio"] *= 1.1
    assert len(complaints_about(documents(), changed)) == 2
    dearer = json.loads(json.dumps(report.stored()))
    for figure in dearer["figures"]:
        for size in figure["sizes"]:
            size["seconds"] *= 2.0
    assert complaints_about(documents(), dearer) == [
        "docs/scaling.md does not show the stored figures: paste `python -m benchmarks.documents`"
    ]
    lost = json.loads(json.dumps(report.stored()))
    lost["figures"][0] |= {"reached": "NO", "job": "a job that nobody explains"}
    assert any("does not explain" in complaint for complaint in complaints_about(documents(), lost))


def test_the_arithmetic_of_scale() -> None:
    points = growth("points of a sweep into a store", [Size(10, 1e-5, 99.0, 300.0), Size(1000, 1e-5, 100.0, 250.0)])
    flight = Row("a job", "a peer", Comparison(2e-6, 4e-6, 2.0), None)
    data = report.data({"monte_carlo": [flight], "size": points})
    data["machine"]["cores"] = "4"
    data["figures"][0]["ours"] = 0.9
    said = " ".join(arithmetic(data).split())
    for words in (
        "= 10,000 core seconds = 2.8 core hours; on 1000 cores 10.0 s",
        "1e9 / 100,000 = 10,000, 10 a core; each is 1.00 s of work and 25 MB on disk",
        "100 MB a process",
        "= 250 GB",
        "250 s = 4.2 minutes",
        "1e6 x 0.9 s x 4 processes = 1000 core hours, 60 minutes on 1000 cores.",
    ):
        assert words in said


def test_every_stored_verdict_follows_from_its_figures() -> None:
    data = report.stored()
    assert len(data["figures"]) >= 15
    for figure in data["figures"]:
        timing = Comparison(figure["ours"], figure["peers"], figure["ratio"])
        again = Row(figure["job"], figure["peer"], timing, figure["to_reach"])
        assert again.verdict == figure["reached"], figure["job"]
        assert figure["ratio"] == pytest.approx(figure["peers"] / figure["ours"], rel=0.2)
