"""Command `hfa prove cost`."""

from __future__ import annotations

import json
import shutil
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

import hfa
from hfa.main import main
from hfa_flight.problem import flight_problem
from hfa_optimal.bracket import bracket_of, bracket_sentence
from hfa_prove.certificate import read_content, read_sealed, sealed
from hfa_prove.problem import given_of
from hfa_prove.statements.cost import CostStatement
from hfa_prove.statements.plant import Subject
from hfa_prove.subject import compare
from hfa_support.errors import NoSolutionError

EXAMPLES = Path(__file__).parents[3] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"
AIRCRAFT = ("--aircraft", PENDULUM)


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cost") / "cost.json"
    assert main(["prove", "cost", *AIRCRAFT, "--degree", "2", "-o", str(path)]) == 0
    return path


@pytest.fixture(scope="module")
def statement(certificate: Path) -> CostStatement:
    """Return the statement in the certificate, without its proof."""
    return read_content(read_sealed(certificate)[0], Subject(hfa.load_model(PENDULUM)))[0]


def test_a_bound_is_proved_and_checked(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A certificate is verified by `hfa prove`.

    The first line names the weights if only the certificate contains them.
    """
    assert main(["prove", *AIRCRAFT, "--check", str(certificate)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "of the weights in the certificate" in out
    words = ["prove", *AIRCRAFT, "--Q", "1,1", "--R", "1", "--check", str(certificate)]
    assert main([*words, "--json"]) == 0
    data = json.loads(capsys.readouterr().out)
    assert data["proved"]
    assert data["levels"][0] < data["levels"][-1]


def test_a_run_is_resumed_from_its_certificate(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """--resume keeps the pieces of the certificate. A certificate with other weights is refused."""
    path = tmp_path / "cost.json"
    shutil.copy(certificate, path)
    words = ["prove", "cost", *AIRCRAFT, "--degree", "4", "--resume", "-o", str(path)]
    assert main([*words, "--R", "9"]) == 2
    assert "R in the certificate differs" in capsys.readouterr().err
    before = json.loads(certificate.read_text())["statement"]["pieces"]
    assert main([*words, "--seconds", "0.05", "--json"]) == 0
    pieces = json.loads(capsys.readouterr().out)["levels"]
    assert pieces[: len(before)] == [piece["c"] for piece in before]


def test_a_certificate_of_another_kind_is_refused(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A region does not resume from a bound of the cost, and an unknown kind is not read.

    Both are refused in one line, and the file is unchanged.
    """
    path = tmp_path / "cost.json"
    shutil.copy(certificate, path)
    before = path.read_bytes()
    words = ["prove", "region", *AIRCRAFT, "--Q", "1,1", "--R", "1", "--seconds", "1"]
    assert main([*words, "--resume", "-o", str(path)]) == 2
    assert path.read_bytes() == before
    assert len(capsys.readouterr().err.splitlines()) == 1
    content, _ = read_sealed(certificate)
    body = {key: value for key, value in content.items() if key not in ("digest", "checksum")}
    origin = json.dumps(body.pop("provenance"))
    path.write_text(sealed(json.dumps({**body, "kind": "sorcery"})[:-1], origin))
    assert main(["prove", *AIRCRAFT, "--check", str(path)]) == 1
    (line,) = capsys.readouterr().err.splitlines()
    assert "kind" in line


def test_a_hidden_state_that_changes_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """`hfa prove cost` refuses the HFA.

    The derivatives of its states depend on the altitude, which the cost omits.
    """
    assert main(["prove", "cost", "--dihedral", "10"]) == 2
    assert "depend on altitude, which the cost does not include" in capsys.readouterr().err


def test_a_margin_outside_its_range_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """A margin outside its range is refused with this range."""
    assert main(["prove", "cost", *AIRCRAFT, "--margin", "2"]) == 2
    assert "; give a number from 0.0001 to 0.99" in capsys.readouterr().err


def test_command_and_function_report_equal_bounds(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command and the Python function report the same bounds of the least cost."""
    words = ["optimize", *AIRCRAFT, "--start", "angle=10", "--bound", str(certificate)]
    assert main(words) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert "between 1.00 and 1.0" in first
    model = hfa.load_model(PENDULUM)
    point = hfa.trim(model)
    start = {"angle": float(np.radians(10.0))}
    best = hfa.optimize(model, point, start, bound=certificate)
    assert best.lower_bound is not None
    assert 0.9 * best.cost < best.lower_bound < best.cost
    assert f"and {best.over_bound:.2f} of" in first
    assert f"The least cost is in [{best.lower_bound:.6g}, {best.cost:.6g}]" in best.report().text()


def test_an_initial_condition_above_the_level_is_bounded(statement: CostStatement) -> None:
    """If W exceeds the certificate's level at the initial condition, the lower bound is the level.

    The sentence on the bounds reports initial conditions beyond the level.
    """
    small = replace(statement, pieces=statement.pieces[:1])
    near, far = (bracket_of(small, z, {}, 1e3) for z in (np.full(2, 1e-3), np.full(2, 9.0)))
    assert (near.beyond, far.beyond) == (False, True)
    assert far.lower_bound == small.level
    assert bracket_sentence([(far, far.best)]).startswith("beyond the level")
    both = bracket_sentence((each, each.best) for each in (near, far))
    assert both.endswith("of the best possible, 1 beyond the level")


def test_a_bound_within_narrower_limits_is_refused(statement: CostStatement) -> None:
    """A bound that was proved within narrower limits is refused."""
    model = hfa.load_model(PENDULUM)
    problem = flight_problem(model, hfa.trim(model))
    given = given_of(problem, "this command", {})
    compare(statement, given)
    limits = {**statement.plant.limits, "angle": (-0.5, 0.5)}
    narrower = replace(statement, plant=replace(statement.plant, limits=limits))
    with pytest.raises(
        NoSolutionError,
        match="limit of angle in the certificate differs from the value of this command",
    ):
        compare(narrower, given)


def test_a_bound_of_other_weights_is_refused(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`hfa optimize` refuses a bound for other weights."""
    words = ["optimize", *AIRCRAFT, "--start", "angle=10", "--Q", "1,2"]
    assert main([*words, "--bound", str(certificate)]) == 2
    assert "Q in the certificate differs from the value of --Q" in capsys.readouterr().err
