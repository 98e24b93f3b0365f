"""Certificates with parts removed or changed. Every claim that is still accepted is true.

In true and in false certificates every list is emptied, shortened, or gets an entry twice. Every
interval becomes a point, every entry is removed, and every pair is exchanged. `certificate_truth`
tests accepted claims in doubles, by another method than the checker's.
"""

from __future__ import annotations

import copy
from pathlib import Path

import numpy as np
import pytest
from certificate_truth import false_claims
from forged_certificates import (
    CLAIM,
    CONTROLLER,
    Change,
    Content,
    array,
    false_statements,
    put,
    removals,
    several,
    wrong_critics_without_a_claim,
)
from proof_cases import PROOFS, certificate, forge, model_of

from hfa import BadInputError
from hfa_prove import check_certificate
from hfa_prove.fields import Malformed, Rejected
from hfa_prove.report import checked_report
from hfa_support.reporting.report import Report

LARGE_GAMES = [
    pytest.param(kind, marks=pytest.mark.slow) for kind in ("one of two", "solution", "critic")
]
#: Kind -> largest numbers of removals from the true certificate and from false statements.
ALONE = 300
COMBINED = 100


def checked(made: Content, kind: str, folder: Path) -> Report | None:
    """Return the report of a certificate, or None if it is refused."""
    try:
        verified = check_certificate(forge(folder / "forged.json", made), model=model_of(kind))
    except (Rejected, BadInputError, Malformed):
        return None
    return checked_report(verified)


def changed(kind: str, *changes: Change) -> Content | None:
    """Return a certificate with changes, or None if a change cannot be made.

    kind: kind of the certificate
    changes: functions that change the content of the certificate in place
    """
    made = copy.deepcopy(certificate(kind))
    try:
        for change in changes:
            change(made)
    except (LookupError, TypeError, ValueError):
        return None
    return made


def assert_true_or_refused(kind: str, names: list[tuple[str, ...]], folder: Path) -> int:
    """Assert that all claims of accepted changed certificates are true.

    Returns the number of accepted certificates.

    names: changes of each certificate: a removal, or a false statement and a removal
    """
    every_removal = removals(certificate(kind))
    statements = false_statements(kind)
    accepted = 0
    for each in names:
        made = changed(kind, *[statements.get(name) or every_removal[name] for name in each])
        if made is None:
            continue
        claims = copy.deepcopy(made["statement"])
        if checked(made, kind, folder) is not None:
            assert false_claims(claims, kind) == [], each
            accepted += 1
    return accepted


def some_removals(kind: str, count: int, seed: int = 3) -> list[tuple[str, ...]]:
    """Return the names of `count` random removals from a true certificate.

    If there are fewer removals, all names are returned.
    """
    names = sorted(removals(certificate(kind)))
    order = np.random.default_rng(seed).permutation(len(names))
    return [(names[number],) for number in order[:count]]


def combined(kind: str, count: int, seed: int = 0) -> list[tuple[str, ...]]:
    """Return random pairs of a false statement and a removal."""
    random = np.random.default_rng(seed)
    statements = sorted(false_statements(kind))
    every_removal = sorted(removals(certificate(kind)))
    return [(random.choice(statements), random.choice(every_removal)) for _ in range(count)]


def test_certificates_with_random_removals_remain_true(tmp_path: Path) -> None:
    """If a certificate with a part removed is accepted, its claim is true.

    With combined changes none is accepted.
    """
    for kind in PROOFS:
        assert_true_or_refused(kind, some_removals(kind, 1), tmp_path)
        assert assert_true_or_refused(kind, combined(kind, 1, seed=1), tmp_path) == 0


@pytest.mark.slow
@pytest.mark.parametrize("kind", PROOFS)
def test_accepted_certificates_with_removals_are_true(kind: str, tmp_path: Path) -> None:
    """Of all removals, fewer than half are accepted, with true claims.

    Combined changes are accepted in less than 10 % of the cases.
    """
    accepted = assert_true_or_refused(kind, some_removals(kind, ALONE), tmp_path)
    assert accepted < len(some_removals(kind, ALONE)) / 2
    false_ones = combined(kind, COMBINED)
    assert assert_true_or_refused(kind, false_ones, tmp_path) < COMBINED / 10


def test_there_are_thousands_of_removals() -> None:
    """Each kind has more than 150 removals, and there are more than 4,900 changed certificates in
    all.
    """
    counts = [len(some_removals(kind, ALONE)) for kind in PROOFS]
    assert min(counts) > 150
    assert sum(counts) + COMBINED * len(PROOFS) > 4900


@pytest.mark.parametrize("kind", ["scalar", "plant", *LARGE_GAMES])
def test_a_wrong_critic_without_claims_is_not_proved(kind: str, tmp_path: Path) -> None:
    """A wrong critic is not reported as proved if the certificate claims nothing about it."""
    for name, change in wrong_critics_without_a_claim(kind).items():
        made = changed(kind, change)
        assert made is not None
        report = checked(made, kind, tmp_path)
        if "no distance" in name:
            assert report is None, name
        elif report is not None:
            assert false_claims(made["statement"], kind) == [], name
            assert report.data["proved"] is (made["statement"]["loop"][1] == 0), name
            assert report.title.startswith("Verified, proved") is report.data["proved"], name


def test_the_first_line_reports_open_stability(tmp_path: Path) -> None:
    """For a wrong gain whose stability is not claimed, the first line reports open stability."""
    made = changed(
        "plant",
        put(array(lambda K: -5.0 * K), *CLAIM, "critic", "K"),
        put([5.9, 6.1], *CLAIM, "distances", "K"),
        put([0, 2], *CLAIM, "loop"),
        put([], "witness", "loop"),
    )
    assert made is not None
    report = checked(made, "plant", tmp_path)
    assert report is not None
    assert report.title.startswith("Verified, but whether the gain stabilizes is open")
    assert report.data["proved"] is False


@pytest.mark.parametrize(("value", "delay", "share"), [(1.8, 0.02, -1.0), (1e-9, 1e9, 1.0)])
def test_uncertain_actuators_without_pieces_are_refused(
    value: float, delay: float, share: float, tmp_path: Path
) -> None:
    """A claim for uncertain actuators is refused if the evidence contains no pieces."""
    actuators = (*CLAIM, "actuators")
    without_pieces = [
        put([], "witness", "loop", i, "pieces")
        for i in range(len(certificate("actuators")["witness"]["loop"]))
    ]
    made = changed(
        "actuators",
        put([value, value], *actuators, "bandwidth"),
        put(delay, *actuators, "delay"),
        put(array(lambda K: share * K), *CONTROLLER, "D"),
        several(*without_pieces),
    )
    assert made is not None
    assert checked(made, "actuators", tmp_path) is None


def test_a_decay_rate_without_stability_is_refused(tmp_path: Path) -> None:
    """A decay rate is refused for a loop whose stability is proved at no scheduling value.

    Without the rate the certificate is accepted, and its report is "not proved".
    """
    opened = put(lambda runs: [[runs[0][0], runs[-1][1], 0, 6]], *CLAIM, "loop")
    made = changed("rate", opened, put(1e6, *CLAIM, "decay_rate"))
    assert made is not None
    assert checked(made, "rate", tmp_path) is None
    made = changed(
        "rate", opened, put(0.0, *CLAIM, "decay_rate"), put(None, *CLAIM, "scheduled_rate")
    )
    assert made is not None
    made["witness"].pop("motion")
    report = checked(made, "rate", tmp_path)
    assert report is not None
    assert report.data["proved"] is False
    assert "decay rate" not in report.text()


@pytest.mark.parametrize("at", [1.0625, 1.25, 1.5])
def test_a_second_branch_is_refused_without_its_boxes(at: float, tmp_path: Path) -> None:
    """A claim about the branch x = -sqrt(1 + p) is refused without boxes for it.

    The loop is not stable on this branch.
    """
    second = {"breakpoint": at, "unknowns": {"x": -float(np.sqrt(1.0 + at))}}
    made = changed("two trims", put(lambda trims: [*trims, second], *CLAIM, "flight", "trims"))
    assert made is not None
    assert checked(made, "two trims", tmp_path) is None
