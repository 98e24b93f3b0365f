"""The checker: what the prover made passes, and what was changed does not."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from proof_cases import certificate, content, exact_table, forge, proved

import hfa_model
from hfa_model import INPUTS, STATES
from hfa_support import BadInputError
from trim import release
from trim.hfa.level_flight import LEVEL_FLIGHT
from verification import Family, check_certificate, prove_schedule
from verification.proof.checker import checker
from verification.proof.checker.checker import Rejected
from verification.proof.search.proof_report import checked_report, crossings, joined

Content = dict[str, Any]


def test_what_was_proved_is_verified(tmp_path: Path) -> None:
    found = check_certificate(forge(tmp_path / "own.json", certificate("rate")))
    assert found.kind == "schedule"
    for name, count in (("loop", 0), ("modes", 2), ("motion", 0)):
        assert joined(found.covers[name]) == [(14.0, 14.125, count)]
    assert found.rate == proved("rate").data["decay_rate"]
    assert found.statement["place_rate"] > 25.0


@pytest.mark.parametrize("name", ["loop", "modes", "motion"])
def test_what_is_neither_proved_nor_said_to_be_open_is_refused(name: str, tmp_path: Path) -> None:
    """Also when too much is declared open: the boxes and the open intervals cover the interval
    once."""
    path, own = tmp_path / "short.json", copy.deepcopy(certificate("rate"))
    last = own["boxes"][name].pop()["range"]
    for said in (
        [],
        [[last[0], (last[0] + last[1]) / 2]],
        [[last[0], last[1] + 1e-9]],
        [[last[0] - 1e-9, last[1]]],
    ):
        own["open"][name] = said
        with pytest.raises(Rejected, match="do not cover the interval once"):
            check_certificate(forge(path, own))
    own["open"][name] = [last]
    report = checked_report(check_certificate(forge(path, own)))
    whole = name == "modes"  # a count that is open is no less a proof of the loop
    assert report.data["proved"] is whole
    assert report.title.startswith(
        "Verified, proved" if whole else "Verified, but not proved on the whole interval"
    )
    assert f"{last[0]:g} to {last[1]:g}" in report.text()
    if name == "loop":
        assert report.data["open"] == [tuple(last)]


def test_bounds_of_the_number_of_modes_are_verified(tmp_path: Path) -> None:
    """A of `published` gains a third unstable mode at 16.688 deg; one that is claimed too few or
    too many is not."""
    path, own = tmp_path / "forged.json", certificate("crossing")
    (crossing,) = crossings(proved("crossing"))
    assert checked_report(check_certificate(forge(path, own))).data["crossings"] == [crossing]
    for name, other in (("least", "most"), ("most", "least")):
        forged = copy.deepcopy(own)
        forged["boxes"][name] = own["boxes"][other]
        with pytest.raises(Rejected, match="not those that are unstable"):
            check_certificate(forge(path, forged))
        forged = copy.deepcopy(own)
        forged["boxes"][name][0]["unstable"] += 1 if name == "least" else -1
        with pytest.raises(Rejected, match="negative eigenvalues"):
            check_certificate(forge(path, forged))


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": "other", "digest": "0"}', "[" * 100_000]
)
def test_what_is_no_certificate_is_said(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(BadInputError):
        check_certificate(path)


def test_where_alpha_is_free_the_derivative_follows_the_pitch_with_it(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Of the trim's equations along each unknown, against central differences; pitch = alpha +
    gamma."""
    flights = Family(
        hfa_model.aircraft(), release(LEVEL_FLIGHT, free=("alpha",), hold={"elevator_outer": 0.0})
    )
    own = content(prove_schedule(flights, exact_table(14.0, 14.125), 14.0, 14.0625))
    box, found = own["boxes"]["loop"][0], list[Any]()
    whole = checker.check_root

    def watched(residual: Any, derivative: Any, radii: Any) -> Any:
        found.append(derivative.range())
        return whole(residual, derivative, radii)

    monkeypatch.setattr(checker, "check_root", watched)
    checker.model_on(own["statement"], box, flights.model)

    point = dict.fromkeys((*STATES, *INPUTS), 0.0) | own["statement"]["imposed"]
    point |= {name: numbers[0] for name, numbers in box["trim"].items()}
    point |= {
        "dihedral": np.radians(np.mean(box["range"])),
        "pitch": point["alpha"] + point["gamma"],
    }

    def rates(name: str, step: float) -> np.ndarray:
        at = point | {name: point[name] + step}
        at["pitch"] += step * (name == "alpha")
        values = flights.aircraft.at([at[each] for each in STATES], [at[each] for each in INPUTS]).f
        return values[
            [STATES.index(each) for each in ("speed", "alpha", "pitch_rate", "dihedral_rate")]
        ]

    differences = np.transpose(
        [(rates(name, 1e-5) - rates(name, -1e-5)) / 2e-5 for name in box["trim"]]
    )
    middle = np.array([[float(entry.mid()) for entry in row] for row in found[0].tolist()])
    np.testing.assert_allclose(
        middle, differences, rtol=1e-3, atol=1e-3 * np.abs(differences).max()
    )
