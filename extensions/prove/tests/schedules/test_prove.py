"""`hfa prove`: statements, certificates, and one-line errors."""

from __future__ import annotations

import json
import os
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from proof_cases import unstable_between

from hfa.entry_points import words_after
from hfa_prove.commands.check import STATEMENTS


@pytest.fixture(autouse=True)
def _in_a_folder(folder: Path) -> None:
    """Run each test in a new empty folder."""


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("prove") / "certificate.json"
    result = hfa("prove", "schedule", "--dihedral", "14:14.25", "--rate", "-o", str(path), "--json")
    assert (result.code, result.err) == (0, "")
    data = json.loads(result.out)
    assert data["proved"] is True
    assert data["loop"]["proved"] == [{"from_deg": 14.0, "to_deg": 14.25, "unstable": 0}]
    return path


@pytest.fixture(scope="module")
def certificates(certificate: Path, tmp_path_factory: pytest.TempPathFactory) -> dict[str, Path]:
    """Return the path of a certificate of each kind, by kind."""
    folder = tmp_path_factory.mktemp("kinds")
    solved = folder / "solved.json"
    assert hfa("solve", "--dihedral", "15", "-o", str(solved)).code == 0
    words = {
        "solution": ("prove", "solution", "--dihedral", "15", "-o"),
        "critic": ("prove", "critic", "--dihedral", "15", str(solved), "-o"),
        "errors": ("prove", "schedule", "--dihedral", "14:14.25", "--error", "1", "-o"),
    }
    found = {kind: folder / f"{kind}.json" for kind in words}
    for kind, each in words.items():
        result = hfa(*each, str(found[kind]))
        assert (result.code, result.err) == (0, ""), kind
    return {"schedule": certificate} | found


@pytest.mark.parametrize("kind", ["schedule", "errors", "solution", "critic"])
def test_a_certificate_of_each_kind_is_verified(certificates: dict[str, Path], kind: str) -> None:
    """A certificate of each kind is verified without further options.

    The data contains the version, command and date of the certificate.
    """
    result = hfa("prove", "--check", str(certificates[kind]), "--json")
    assert result.code == 0
    data = json.loads(result.out)
    origin = json.loads(certificates[kind].read_text())["provenance"]
    assert data["proved"] is True
    assert data["written"] == {key: origin[key] for key in ("version", "command", "date")}
    assert origin["command"].endswith(
        str(certificates[kind]) + (" --json" if kind == "schedule" else "")
    )
    assert (origin["date"], origin["dynamics"]) == ("2026-09-21T14:13:20Z", "published")
    assert origin["parameter_hash"] == data["parameter_hash"]


def test_a_certificate_is_compared_with_the_users_data(
    certificates: dict[str, Path], tmp_path: Path
) -> None:
    """A certificate is accepted if the user gives the gains, weights and angles that it contains.

    Other values give exit code 1. An option for a field that the certificate does not contain gives
    exit code 2.
    """
    critic = str(certificates["critic"])
    schedule = str(certificates["schedule"])
    solved = str(certificates["critic"].parent / "solved.json")
    table = tmp_path / "table.npz"
    stated = json.loads(Path(schedule).read_text())["statement"]["controller"]
    gains = {"dihedral_deg": np.array(stated["breakpoints"]), "K": -np.array(stated["D"])}
    np.savez(table, **gains)
    same = hfa(
        "prove",
        "--check",
        critic,
        "--weights",
        solved,
        "--delta",
        "200",
        "--dihedral",
        "15",
        "--json",
    )
    data = json.loads(same.out)
    assert (same.code, data["game"]["delta"], len(data["statement_sha256"])) == (0, 200.0, 64)
    assert data["limits"]["throttle"] == [0.0, 200.0]
    assert hfa("prove", "--check", schedule, "--weights", str(table)).code == 0
    gains["K"][0, 0, 0] = np.nextafter(gains["K"][0, 0, 0], 1.0)
    np.savez(table, **gains)
    network = table.with_suffix(".onnx")
    network.write_bytes(b"")
    for words, code in (
        ((schedule, "--weights", str(table)), 1),
        ((schedule, "--dihedral", "14:15"), 1),
        ((critic, "--delta", "201"), 1),
        ((critic, "--Q", "1,2,3,4,5,6"), 1),
        ((schedule, "--delta", "200"), 2),
        ((critic, "--weights", solved, "--set", "activation=tanh"), 2),
        ((critic, "--weights", str(network)), 2),
    ):
        assert_refused(hfa("prove", "--check", *words), code, "certificate")
    held = hfa("prove", "--check", schedule, "--hold", "speed=70")
    assert_refused(held, 1, "speed in the certificate differs from the value of --hold")


def test_reports_describe_the_certified_aircraft(tmp_path: Path) -> None:
    """The report of a check names the dynamics, parameters and trims stated in the certificate."""
    certificate = str(tmp_path / "newton.json")
    of_certificate = (
        "--dynamics",
        "newton",
        "--parameters",
        "gibson-2011-simulation",
        "--hold",
        "speed=70",
    )
    assert (
        hfa("prove", "solution", "--dihedral", "12", *of_certificate, "-o", certificate).code == 0
    )
    assert_refused(hfa("prove", "solution", "--check", certificate), 2, "unknown option --check")
    out = " ".join(hfa("prove", "--check", certificate).out.split())
    assert (
        f"on 2026-09-21T14:13:20Z: hfa prove solution --dihedral 12 {' '.join(of_certificate)} -o "
        in out
    )
    assert "newton dynamics, parameters gibson-2011-simulation (" in out
    assert "trims at speed 70 ft/s, alpha 2.8 deg" in out
    assert "published" not in out
    data = json.loads(hfa("prove", "--check", certificate, "--json").out)
    assert (data["dynamics"], data["parameters"]) == ("newton", "gibson-2011-simulation")
    assert data["provenance"]["dynamics"] == ""


def test_the_digest_does_not_depend_on_date(certificate: Path, tmp_path: Path) -> None:
    """The digest of a certificate does not depend on the date. A file with an edited date is
    refused.
    """
    again = tmp_path / "again.json"
    with pytest.MonkeyPatch.context() as patch:
        patch.setenv("SOURCE_DATE_EPOCH", "0")
        assert (
            hfa("prove", "schedule", "--dihedral", "14:14.25", "--rate", "-o", str(again)).code == 0
        )
    first, second = (json.loads(path.read_text()) for path in (certificate, again))
    assert first["digest"] == second["digest"]
    assert (first["provenance"]["date"], second["provenance"]["date"]) == (
        "2026-09-21T14:13:20Z",
        "1970-01-01T00:00:00Z",
    )
    assert {key for key in first if first[key] != second[key]} == {"provenance", "checksum"}
    again.write_text(again.read_text().replace("1970-01-01", "1971-01-01"))
    assert_refused(hfa("prove", "--check", str(again)), 2, "again.json", "edited")


def test_a_finished_certificate_is_resumed_at_once(certificate: Path, tmp_path: Path) -> None:
    """Resuming a finished certificate leaves it unchanged.

    Edited certificates and other statements are refused.
    """
    copy = tmp_path / "copy.json"
    copy.write_text(certificate.read_text())
    result = hfa(
        "prove", "schedule", "--dihedral", "14:14.25", "--rate", "-o", str(copy), "--resume"
    )
    assert result.code == 0
    assert json.loads(copy.read_text())["digest"] == json.loads(certificate.read_text())["digest"]
    edited = copy.read_text().replace('"rate": 0.3', '"rate": 0.4', 1)
    copy.write_text(edited)
    assert_refused(
        hfa("prove", "schedule", "--dihedral", "14:14.25", "-o", str(copy), "--resume"), 2, "edited"
    )
    assert copy.read_text() == edited
    copy.write_text(certificate.read_text())
    other = hfa("prove", "schedule", "--dihedral", "14:14.5", "-o", str(copy), "--resume")
    assert_refused(other, 2, "another statement or version")


def test_a_gain_table_unstable_between_angles_is_refuted(tmp_path: Path) -> None:
    """A gain table that is unstable between its angles is refuted, with exit code 1."""
    table = unstable_between(15.0, 15.03)
    path = tmp_path / "table.json"
    controller = table.controller
    stored = {"dihedral_deg": controller.breakpoints.tolist(), "K": (-controller.D).tolist()}
    path.write_text(json.dumps(stored))
    result = hfa("prove", "schedule", "--dihedral", "15.014:15.016", "--weights", str(path))
    assert result.code == 1
    assert result.out.startswith("Refuted")
    assert "unstable modes at every angle from 15.014 to 15.016 deg" in result.out


def test_a_fifo_is_refused_as_certificate(tmp_path: Path) -> None:
    """A named pipe is refused as a certificate."""
    os.mkfifo(tmp_path / "fifo.json")
    assert_refused(hfa("prove", "--check", str(tmp_path / "fifo.json")), 2, "fifo")


def test_all_statements_are_named_without_a_certificate() -> None:
    """`hfa prove` alone names each statement that has a command."""
    assert sorted(STATEMENTS) == sorted(words_after("prove"))
    assert_refused(hfa("prove"), 2, f"choose from {', '.join(STATEMENTS)}, or add --check FILE")


def test_a_certificate_has_no_cross_weights() -> None:
    """Cross weights are refused by name in a plant file and in the option --N."""
    parts = {"A": [[0.0, 1.0], [2.0, -0.3]], "B": [[0.0], [1.0]], "Q": np.eye(2), "R": np.eye(1)}
    np.savez("plain.npz", **parts)
    np.savez("crossed.npz", **parts, N=[[0.1], [0.2]])
    assert hfa("prove", "solution", "--model", "plain.npz", "-o", "proof.json").code == 0
    for words in (
        ("solution", "--model", "crossed.npz"),
        ("solution", "--model", "plain.npz", "--N", ".1;.2"),
        ("--check", "proof.json", "--model", "crossed.npz"),
        ("--check", "proof.json", "--model", "plain.npz", "--N", ".1;.2"),
    ):
        refused = hfa("prove", *words)
        assert refused.code == 2, words
        assert "N" in refused.err
        assert "remove" in refused.err


def test_a_missing_package_is_named_with_what_pip_installs(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Without cvxpy (hidden here), a proof that needs it ends in one line with the pip command."""
    monkeypatch.setitem(sys.modules, "cvxpy", None)
    words = ("prove", "schedule", "--dihedral", "14:14.05", "--bandwidth", "50:60")
    assert_refused(hfa(*words), 2, "cvxpy", "python -m pip install python-flint cvxpy")


def test_a_check_loads_nothing_of_the_search() -> None:
    """Checks of a solution, a region and a bound of the cost load no module of the search."""
    root = Path(__file__).parents[4]
    stored = root / "tests" / "nets" / "certificates"
    pendulum = ["--aircraft", f"{root / 'examples' / 'pendulum.py'}:PENDULUM"]
    checks = [["prove", "--check", str(stored / "solution.json"), "-q"]]
    for name in ("region", "cost"):
        checks.append(["prove", "--check", str(stored / f"{name}.json"), "-q", *pendulum])
    text = (
        "import sys; from hfa.main import main; "
        f"codes = [main(words) for words in {checks!r}]; "
        "print(codes, [name for name in sys.modules if name.startswith('hfa_prove.search')])"
    )
    done = subprocess.run([sys.executable, "-c", text], capture_output=True, text=True, check=True)
    assert done.stdout.splitlines()[-1] == "[0, 0, 0] []"
