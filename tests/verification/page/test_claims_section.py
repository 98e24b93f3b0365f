"""Claims on the page: read back, refused when damaged, and whether they flew the aircraft of the page."""

from __future__ import annotations

import copy
import json
from pathlib import Path

import pytest
from project import ROOT

from hfa_support import BadInputError
from hfa_support.reporting.text import Table
from verification.page.claims_section import claims_section, flies_the_same, load_claims
from verification.page.main_job import MainJob, StoredClaims

STORED = ROOT / "studies" / "section5" / "results"


@pytest.fixture(scope="module")
def claims() -> StoredClaims:
    return load_claims(STORED)


def test_a_row_each_with_the_verdict_that_is_stored(job: MainJob, claims: StoredClaims) -> None:
    section = claims_section(claims, job.regeneration)
    (table,) = (part for part in section.parts if isinstance(part, Table))
    stored = claims.table["claims"]
    assert [(row[0], row[-1]) for row in table.rows] == [(claim["number"], claim["verdict"]) for claim in stored]
    assert {row[-1].tone for row in table.rows if row[-1] == "not confirmed"} == {"bad"}
    assert "the same matrices as" in str(section.parts[1])


def test_another_aircraft_is_noticed(job: MainJob, claims: StoredClaims) -> None:
    other = copy.deepcopy(claims.table)
    assert flies_the_same(other, job.regeneration)
    other["setting"]["models"][1]["B"][3][4] *= 1 + 1e-6
    assert not flies_the_same(other, job.regeneration)
    section = claims_section(StoredClaims(claims.path, other), job.regeneration)
    assert "OTHER matrices than" in str(section.parts[1])


def test_without_claims_the_page_says_how_to_get_them(job: MainJob) -> None:
    assert "studies.section5" in str(claims_section(None, job.regeneration).parts[0])


@pytest.mark.parametrize("key", ["claims", "verdicts", "setting"])
def test_a_damaged_table_is_refused(key: str, claims: StoredClaims, tmp_path: Path) -> None:
    table = {name: value for name, value in claims.table.items() if name != key}
    (tmp_path / "claims.json").write_text(json.dumps(table), encoding="utf-8")
    with pytest.raises(BadInputError, match=f"is damaged .*{key}"):
        load_claims(tmp_path)
