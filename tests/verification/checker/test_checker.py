"""The checker: what the prover made passes, and what was changed does not."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import ctx
from proof_cases import ORIGIN, exact_table, family, forge

from hfa_model import INPUTS, STATES, Aircraft
from hfa_support import BadInputError
from trim import release
from trim.point.condition import LEVEL_FLIGHT
from verification import Family, check_certificate, prove_rate, prove_schedule
from verification.arithmetic import PRECISION
from verification.checker import checker
from verification.checker.checker import Rejected
from verification.proof import certificate_file
from verification.proof.certificate_file import ScheduleCertificate
from verification.proof.proof_report import checked_report
from verification.proof.schedule_proof import joined

Content = dict[str, Any]


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The certificate of 14 to 15 deg."""
    path = tmp_path_factory.mktemp("proof") / "certificate.json"
    flights, table = family(), exact_table(14.0, 15.0)
    file = ScheduleCertificate(flights, table, 14.0, 15.0, path, ORIGIN)
    found = prove_schedule(flights, table, 14.0, 15.0)
    file.finish(found, prove_rate(flights, table, 14.0, 15.0))
    assert [one.counts for one in file.known()] == [found.loop.counts, found.modes.counts]
    return path


def test_what_was_proved_is_verified(proved: Path) -> None:
    found = check_certificate(proved)
    assert found.kind == "schedule"
    assert [joined(found.covers[name]) for name in ("loop", "modes", "motion")] == [
        [(14.0, 15.0, 0)],
        [(14.0, 15.0, 2)],
        [(14.0, 15.0, 0)],
    ]
    assert 0.29 < found.rate < 0.36
    assert found.statement["place_rate"] > 25.0


def test_an_interrupted_proof_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificate_file, "_PAUSE", 0.0)
    path, flights, table = tmp_path / "certificate.json", family(), exact_table(14.0, 15.0)

    def interrupted(done: int, total: int) -> None:
        if done > 0.6 * total:
            raise KeyboardInterrupt

    file = ScheduleCertificate(flights, table, 14.0, 15.0, path, ORIGIN)
    with pytest.raises(KeyboardInterrupt):
        prove_schedule(flights, table, 14.0, 15.0, save=file.save, progress=interrupted)
    assert joined(check_certificate(path).covers["modes"]) != [(14.0, 15.0, 2)]
    known = file.known()
    assert ctx.prec == PRECISION  # the checker's is another
    found = prove_schedule(flights, table, 14.0, 15.0, known=known, save=file.save)
    assert found.proved
    file.finish(found)
    assert joined(check_certificate(path).covers["modes"]) == [(14.0, 15.0, 2)]


def test_a_partial_certificate_that_was_forged_is_not_continued(proved: Path, tmp_path: Path) -> None:
    content = json.loads(proved.read_text())
    content["boxes"]["loop"][0]["rate"] = 0.5
    path = tmp_path / "forged.json"
    forge(path, content)
    with pytest.raises(BadInputError, match=r"is not proved.*; remove the file and begin again"):
        ScheduleCertificate(family(), exact_table(14.0, 15.0), 14.0, 15.0, path, ORIGIN).known()


@pytest.mark.parametrize("name", ["loop", "modes", "motion"])
def test_what_is_neither_proved_nor_said_to_be_open_is_refused(proved: Path, tmp_path: Path, name: str) -> None:
    """Also when too much is declared open: the boxes and the open intervals cover the interval once."""
    content = json.loads(proved.read_text())
    last = content["boxes"][name].pop()["range"]
    for said in ([], [[last[0], (last[0] + last[1]) / 2]], [[last[0], last[1] + 1e-9]], [[last[0] - 1e-9, last[1]]]):
        content["open"][name] = said
        with pytest.raises(Rejected, match="do not cover the interval once"):
            check_certificate(forge(tmp_path / "short.json", content))
    content["open"][name] = [last]
    report = checked_report(check_certificate(forge(tmp_path / "open.json", content)))
    whole = name == "modes"  # a count that is open is no less a proof of the loop
    assert report.data["proved"] is whole
    assert report.title.startswith("Verified, proved" if whole else "Verified, but not proved on the whole interval")
    assert f"{last[0]:g} to {last[1]:g}" in report.text()
    if name == "loop":
        assert report.data["open"] == [tuple(last)]


def test_bounds_of_the_number_of_modes_are_verified(tmp_path: Path) -> None:
    """A of `published` gains a third unstable mode at 16.688 deg; one that is claimed too few or too many is not."""
    path, flights, table = tmp_path / "certificate.json", family(), exact_table(16.6875, 16.6895)
    file = ScheduleCertificate(flights, table, 16.6875, 16.6895, path, ORIGIN)
    found = prove_schedule(flights, table, 16.6875, 16.6895)
    file.finish(found)
    (crossing,) = found.crossings
    data = checked_report(check_certificate(path)).data
    assert crossing[2] == (2, 3)
    assert data["crossings"] == [crossing]
    content = json.loads(path.read_text())
    for name, other in (("least", "most"), ("most", "least")):
        forged = json.loads(path.read_text())
        forged["boxes"][name] = content["boxes"][other]
        with pytest.raises(Rejected, match="not those that are unstable"):
            check_certificate(forge(tmp_path / "forged.json", forged))
        forged["boxes"][name] = content["boxes"][name]
        forged["boxes"][name][0]["unstable"] += 1 if name == "least" else -1
        with pytest.raises(Rejected, match="negative eigenvalues"):
            check_certificate(forge(tmp_path / "forged.json", forged))


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "other", "digest": "0"}', "[" * 100_000])
def test_what_is_no_certificate_is_said(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(BadInputError):
        check_certificate(path)


def test_where_alpha_is_free_the_derivative_follows_the_pitch_with_it(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Of the trim's equations along each unknown, against central differences; pitch = alpha + gamma."""
    path = tmp_path / "certificate.json"
    flights = Family(Aircraft(), release(LEVEL_FLIGHT, free=("alpha",), hold={"elevator_outer": 0.0}))
    table = exact_table(14.0, 14.125)
    ScheduleCertificate(flights, table, 14.0, 14.125, path, ORIGIN).finish(prove_schedule(flights, table, 14.0, 14.125))
    content = json.loads(path.read_text(encoding="utf-8"))
    box, found = content["boxes"]["loop"][0], list[Any]()
    whole = checker.check_root

    def watched(residual: Any, derivative: Any, radii: Any) -> Any:
        found.append(derivative.range())
        return whole(residual, derivative, radii)

    monkeypatch.setattr(checker, "check_root", watched)
    checker.model_on(content["statement"], box, flights.model)

    point = dict.fromkeys((*STATES, *INPUTS), 0.0) | content["statement"]["imposed"]
    point |= {name: numbers[0] for name, numbers in box["trim"].items()}
    point |= {"dihedral": np.radians(np.mean(box["range"])), "pitch": point["alpha"] + point["gamma"]}

    def rates(name: str, step: float) -> np.ndarray:
        at = point | {name: point[name] + step}
        at["pitch"] += step * (name == "alpha")
        values = flights.aircraft.rates([at[each] for each in STATES], [at[each] for each in INPUTS])
        return values[[STATES.index(each) for each in ("speed", "alpha", "pitch_rate", "dihedral_rate")]]

    differences = np.transpose([(rates(name, 1e-5) - rates(name, -1e-5)) / 2e-5 for name in box["trim"]])
    middle = np.array([[float(entry.mid()) for entry in row] for row in found[0].tolist()])
    np.testing.assert_allclose(middle, differences, rtol=1e-3, atol=1e-3 * np.abs(differences).max())
