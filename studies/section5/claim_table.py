"""The claims of claims.toml: what Section 5 says, each sentence with the number that it is checked by."""

from __future__ import annotations

from collections.abc import Iterator
from functools import cache
from pathlib import Path
from typing import Any

from hfa_support.files import read_toml
from studies.section5.claims import LEARNING, TRACKING, Claim
from studies.section5.flown_laws import MODIFIED
from studies.section5.measures import measure_of

#: Laws that are named together.
_TOGETHER = {"learning": LEARNING, "tracking": TRACKING}


def claims_of(section: str) -> tuple[Claim, ...]:
    """The claims of a section, in the order of the file."""
    return tuple(_claim(**entry) for entry in _entries() if entry["number"].startswith(f"{section}-"))


@cache
def _entries() -> tuple[dict[str, Any], ...]:
    table = read_toml(str(Path(__file__).with_name("claims.toml")))
    return tuple(entry for claim in table["claims"] for entry in _each(**claim))


def _each(each: tuple[dict[str, str], ...] = ({},), **claim: Any) -> Iterator[dict[str, Any]]:
    """A claim for every entry of `each`, with its words filled in."""
    for words in each:
        yield _filled(claim, words) | ({"number": words["number"]} if words else {})


def _filled(value: Any, words: dict[str, str]) -> Any:
    if isinstance(value, dict):
        return {key: _filled(each, words) for key, each in value.items()}
    if isinstance(value, list):
        return [_filled(each, words) for each in value]
    return value.format(**words) if words else value


def _claim(
    *,
    number: str,
    says: str,
    measured: str,
    measure: str | dict[str, Any],
    must: str,
    laws: tuple[str, ...] = ("tracking",),
    subject: str = MODIFIED,
    missing: str = "",
    why: str = "",
) -> Claim:
    relation, limit = must.split()
    named = tuple(law for name in laws for law in _TOGETHER.get(name, (name,)))
    criterion = limit if limit.isidentifier() else float(limit)
    return Claim(number, says, measured, measure_of(measure), relation, criterion, named, subject, missing, why)
