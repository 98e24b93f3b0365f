"""The checker accepts certificates of the prover and refuses changed certificates."""

from __future__ import annotations

import copy
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from flint import arb, arb_mat
from proof_cases import PROOFS, certificate, content, exact_loop, forge, model_of

import hfa
from hfa import BadInputError
from hfa_model import INPUTS, STATES
from hfa_prove import Family, check_certificate, prove_schedule
from hfa_prove.certificate import read_statement
from hfa_prove.check import trims
from hfa_prove.fields import Fields, Rejected
from hfa_prove.report import checked_report
from hfa_prove.statements.flight import TrimBox
from hfa_prove.statements.plant import Subject
from trim import release
from trim.hfa.level_flight import LEVEL_FLIGHT

Content = dict[str, Any]


@pytest.mark.parametrize("kind", PROOFS)
def test_a_certificate_is_verified_and_reported(kind: str, tmp_path: Path) -> None:
    """For each kind, the checker verifies the certificate of the prover and reports its whole
    statement.
    """
    path = forge(tmp_path / "own.json", certificate(kind))
    verified = check_certificate(path, model=model_of(kind))
    assert verified.statement.content() == certificate(kind)["statement"]
    report = checked_report(verified)
    assert report.title.startswith("Verified, proved")
    assert report.data["claim"] == certificate(kind)["statement"]
    assert report.data["statement_sha256"][:16] in report.text()


def test_a_written_statement_is_read_unchanged() -> None:
    """A statement that is written and read again equals the original."""
    for kind in PROOFS:
        own = certificate(kind)
        statement = read_statement(
            own["kind"], copy.deepcopy(own["statement"]), Subject(model_of(kind))
        )
        assert statement.content() == own["statement"]


@pytest.mark.parametrize("name", ["loop", "modes", "motion"])
def test_a_missing_box_is_refused_unless_declared_open(name: str, tmp_path: Path) -> None:
    """A certificate without one box is refused, unless its statement declares this interval open."""
    own = copy.deepcopy(certificate("rate"))
    boxes = own["witness"]["motion"]["boxes"] if name == "motion" else own["witness"][name]
    last = boxes.pop()["range"]
    path = tmp_path / "short.json"
    with pytest.raises(Rejected, match="do not cover"):
        check_certificate(forge(path, own))
    if name == "motion":
        return
    own["statement"][name] = [[last[0], last[1], 0, 6]]
    if name == "loop":  # no run is proved stable, so no decay rate is claimed
        with pytest.raises(Rejected, match="decay_rate"):
            check_certificate(forge(path, own))
        own["statement"]["decay_rate"] = 0.0
    report = checked_report(check_certificate(forge(path, own)))
    whole = name == "modes"  # open numbers of A's modes do not affect the proof of the loop
    assert report.data["proved"] is whole
    assert report.title.startswith(
        "Verified, proved" if whole else "Verified, but not proved on the whole interval"
    )
    assert f"{last[0]:g} to {last[1]:g}" in report.text()
    opened = [{"from_deg": last[0], "to_deg": last[1]}]
    assert name == "modes" or report.data["loop"]["open"] == opened


def test_bounds_of_the_number_of_modes_are_verified(tmp_path: Path) -> None:
    """A claim of too few or too many unstable modes is refused.

    At 16.688 deg, a third mode of the `published` dynamics becomes unstable.
    """
    own = certificate("crossing")
    runs = own["statement"]["modes"]
    assert [run[2:] for run in runs] == [[2, 2], [2, 3], [3, 3]]
    for index, bounds in ((0, [3, 3]), (0, [1, 1]), (1, [3, 3]), (1, [2, 2]), (2, [2, 2])):
        forged = copy.deepcopy(own)
        forged["statement"]["modes"][index][2:] = bounds
        with pytest.raises(Rejected, match=r"the boxes of modes with .* do not cover"):
            check_certificate(forge(tmp_path / "forged.json", forged))


@pytest.mark.parametrize(
    "text", ["", "[]", "{}", '{"schema": "other", "digest": "0"}', "[" * 100_000]
)
def test_other_files_are_refused(tmp_path: Path, text: str) -> None:
    """Files that are not certificates are refused."""
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(BadInputError):
        check_certificate(path)


def test_a_missing_certificate_is_refused(tmp_path: Path) -> None:
    """A missing certificate file is refused with its name."""
    with pytest.raises(BadInputError, match=r"none\.json cannot be read \(No such file"):
        check_certificate(tmp_path / "none.json")


def test_the_trim_jacobian_with_free_alpha_is_exact(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """If alpha is free in the trim, the Jacobian of the trim equations equals central differences.

    pitch = alpha + gamma changes with alpha.
    """
    condition = release(LEVEL_FLIGHT, free=("alpha",), hold={"elevator_outer": 0.0})
    flights = Family(hfa.aircraft(), condition)
    proof = prove_schedule(flights, exact_loop(14.0, 14.125), 14.0, 14.0625)
    box = content(proof)["witness"]["loop"][0]
    found = list[Any]()
    whole = trims.root_offsets

    def watched(residual: Any, derivative: Any, radii: Any) -> Any:
        found.append(derivative)
        return whole(residual, derivative, radii)

    # The derivatives are visible only in this call.
    monkeypatch.setattr(trims, "root_offsets", watched)
    entries = Fields("box", {"range": box["range"], "trim": box["trim"]})
    trims.linear_model_on(proof.statement.flight, TrimBox.read(entries, proof.statement.flight))
    imposed = proof.statement.flight.imposed
    point = dict.fromkeys((*STATES, *INPUTS), 0.0) | dict(imposed)
    point |= {name: numbers[1] for name, numbers in box["trim"].items()}
    middle = np.radians(np.mean(box["range"]))
    point |= {"dihedral": middle, "pitch": point["alpha"] + point["gamma"]}
    balanced = [STATES.index(name) for name in ("speed", "alpha", "pitch_rate", "dihedral_rate")]

    def rates(name: str, step: float) -> np.ndarray:
        at = point | {name: point[name] + step}
        at["pitch"] += step * (name == "alpha")
        values = flights.model.at([at[state] for state in STATES], [at[u] for u in INPUTS]).f
        return values[balanced]

    differences = np.transpose(
        [(rates(name, 1e-5) - rates(name, -1e-5)) / 2e-5 for name in box["trim"]]
    )
    slopes = np.array([[float(entry.mid()) for entry in row] for row in found[0].tolist()])
    scale = np.abs(differences).max()
    np.testing.assert_allclose(slopes, differences, rtol=1e-3, atol=1e-3 * scale)


def test_the_enclosed_root_contains_the_offset() -> None:
    """The enclosed root of x² = 2 about 1.4 contains the offset sqrt(2) - 1.4, and not 0.

    A radius that does not contain the root is refused.
    """
    radius = arb("0.1")
    at_center = arb_mat([[arb("1.4") ** 2 - 2]])
    slope = arb_mat([[2 * (arb("1.4") + arb(0, radius))]])
    offset = trims.root_offsets(at_center, slope, [radius])[0, 0]
    assert offset.contains(arb(2).sqrt() - arb("1.4"))
    assert offset > 0
    with pytest.raises(Rejected, match="a root of the equations is not proved to exist"):
        trims.root_offsets(at_center, slope, [arb("0.014")])


@pytest.mark.parametrize("version", [9, 11])
def test_other_formats_are_refused_in_one_line(version: int, tmp_path: Path) -> None:
    """A certificate in the format of another version is refused with what to do."""
    other = certificate("plant") | {"schema": f"hfa.certificate/{version}"}
    said = (
        rf"has the format hfa.certificate/{version} of another version; prove the statement again"
    )
    with pytest.raises(BadInputError, match=said):
        check_certificate(forge(tmp_path / "other.json", other))


def test_a_file_of_another_command_is_no_certificate(tmp_path: Path) -> None:
    """A file with the schema and provenance of another output is refused as no certificate."""
    other = certificate("plant") | {"schema": "hfa.game-solution/1"}
    with pytest.raises(BadInputError, match=r"is not a certificate; give a file written by `hfa"):
        check_certificate(forge(tmp_path / "other.json", other))
