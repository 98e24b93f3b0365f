"""Tests of the benchmarks: equal results of peers, verdicts, and current documents."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from known_models import model_at

import hfa
from benchmarks import __main__ as bench, report
from benchmarks.jobs_flight import FlightCase, c_flight, difference
from benchmarks.jobs_models import f16_case, f16_peer, peer_point, peer_system, six_state_rates
from benchmarks.report import Comparison, Row
from hfa.paper import default_parameters
from hfa_model import LINEAR_STATES, STATES
from hfa_support.errors import BadInputError
from hfa_support.native import machine_code as generated
from trim import trim_points

PARAMETERS = default_parameters().values
ALTITUDE = 40_000.0
NEEDS_COMPILER = pytest.mark.skipif(
    generated.c_compiler() is None, reason="no C compiler on this machine"
)


@pytest.fixture(scope="module")
def case() -> FlightCase:
    return FlightCase()


# Peers compute equal results.


def largest_difference_of_rates(peer, count: int = 200) -> float:
    """Return the largest difference between the state derivatives of a peer and of the aircraft.

    The derivatives of six states are compared at random states and inputs. Each difference is
    relative to the largest derivative of its state.
    """
    rng = np.random.default_rng(3)
    low = np.array([50.0, -0.1, -0.1, -0.3, -0.4, -0.3])
    states = rng.uniform(low, [80.0, 0.15, 0.15, 0.3, 0.4, 0.3], size=(count, 6))
    inputs = rng.uniform(
        [0.0, -0.2, -0.2, -0.2, -0.2], [100.0, 0.2, 0.2, 0.2, 0.2], size=(count, 5)
    )
    aircraft = hfa.aircraft(parameters=PARAMETERS)
    seen = [STATES.index(name) for name in LINEAR_STATES]
    full = np.insert(states, STATES.index("altitude"), ALTITUDE, axis=1)
    ours = np.array([aircraft.at(x, u).f[seen] for x, u in zip(full, inputs, strict=True)])
    theirs = np.array([peer(0.0, x, u, {}) for x, u in zip(states, inputs, strict=True)])
    return float((np.abs(ours - theirs) / np.abs(ours).max(axis=0)).max())


def test_the_peers_dynamics_equal_the_aircrafts() -> None:
    """The peer's state derivatives equal those of the aircraft within 1e-12."""
    assert largest_difference_of_rates(six_state_rates(PARAMETERS, ALTITUDE)) < 1e-12


@pytest.mark.slow
@pytest.mark.filterwarnings("ignore:number of constraints")
def test_python_control_trims_and_linearizes_the_same_aircraft() -> None:
    """python-control finds the same trim, and its finite differences give A and B within 2e-3."""
    peer, model = peer_point(peer_system(), float(np.radians(10.0)))
    exact = model_at(10.0)
    np.testing.assert_allclose(peer.inputs, exact.input_offsets, rtol=1e-6, atol=1e-8)
    np.testing.assert_allclose(model.A, exact.A, atol=2e-3)  # by finite differences
    np.testing.assert_allclose(model.B, exact.B, atol=2e-3)


@pytest.mark.slow
@pytest.mark.parametrize(("turning", "unknowns"), [(False, 5), (True, 12)])
def test_python_control_trims_and_linearizes_the_same_f16(turning: bool, unknowns: int) -> None:
    """python-control finds the same trims and A of the F-16, in level flight and in a turn."""
    condition, name, low, high = f16_case(turning)
    assert len(condition.free) == unknowns
    values = np.linspace(low, high, 5)
    ours = trim_points(condition.model, (name,), values[:, None], condition)
    for i, (point, model) in enumerate(f16_peer(condition)(name, values)):
        np.testing.assert_allclose(point.states, ours.states[i], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(point.inputs, ours.inputs[i], rtol=1e-6, atol=1e-6)
        np.testing.assert_allclose(model.A, ours.A[i], atol=2e-3)  # by finite differences


@pytest.mark.slow
@NEEDS_COMPILER
@pytest.mark.parametrize(("name", "factor"), [("B", 1.0), ("eta", 1.001), ("B", 1.001)])
def test_handwritten_c_gives_the_same_flight(
    case: FlightCase, monkeypatch: pytest.MonkeyPatch, name: str, factor: float
) -> None:
    """Handwritten C gives the same flight within 1e-6, and a planted error is detected."""
    data = case.data()
    # The planted fault: constants of another aircraft.
    monkeypatch.setattr(case, "data", lambda: data | {name: factor * np.asarray(data[name])})
    history = c_flight(case, 300)()
    assert history.shape == (301, 31)
    # The difference is larger than rounding, see `difference`.
    assert (difference(case.fly(False, 300), history) < 1e-6) == (factor == 1.0)


def row(ratio: float, target: float) -> Row:
    return Row("a job", "a peer", Comparison(2e-6, 2e-6 * ratio, ratio), target, "a remark")


def test_figures_of_other_jobs_are_kept_or_nothing_is_stored(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """One job replaces its own stored figures; with another machine it replaces nothing."""
    results = tmp_path / "results.json"
    monkeypatch.setattr(report, "RESULTS", results)
    first, second = list(report.jobs())[:2]
    report.store([{first: [row(3.0, 1.0)], second: [row(5.0, 1.0)]}])
    report.store([{first: [row(4.0, 1.0)]}])
    assert [each["ratio"] for each in report.stored()["figures"]] == [4.0, 5.0]
    before = results.read_bytes()
    monkeypatch.setattr(report, "machine", lambda: {"processor": "another"})
    with pytest.raises(BadInputError, match="run all jobs"):
        report.store([{first: [row(9.0, 1.0)]}])
    assert results.read_bytes() == before


@pytest.mark.slow
def test_every_job_runs_and_quick_runs_store_nothing(
    capsys: pytest.CaptureFixture, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Every benchmark runs with --quick, and no result is stored."""
    # A test must not overwrite the stored results.
    monkeypatch.setattr(report, "store", lambda *_: pytest.fail("stored"))
    assert bench.main(["--quick"]) == 0
    printed = capsys.readouterr().out
    for words in ("python-control", "solve_continuous_are", "F-16", "flights of 0.1 s"):
        assert words in printed


# Stored results, and their tables in docs/scaling.md and benchmarks/README.md.


def not_shown(document: str, data: dict) -> list[str]:
    """Return the table rows of stored results that a document does not contain."""
    rows = [report.markdown([figure]).splitlines()[-1] for figure in data["figures"]]
    rows += [report.growth_markdown([each]).splitlines()[-1] for each in data["growth"]]
    return [row for row in rows if row not in document]


def test_the_document_shows_the_stored_figures() -> None:
    """The documents contain a table row for every stored benchmark result."""
    text = "".join(page.read_text("utf-8") for page in report.PAGES)
    assert not_shown(text, report.stored()) == []
