"""Invariant sets under a disturbance: proved, checked, forged and simulated."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import hfa
from flint import arb
from forged_regions import DISTURBED_KINDS, KINDS
from pendulum_regions import (
    PENDULUM,
    VAN_DER_POL,
    V,
    accepted_forgeries,
    certified,
    pendulum_loop,
    quickly_proved,
)
from scipy.linalg import solve_continuous_lyapunov

from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model
from hfa_prove.certificate import read_content
from hfa_prove.check import check_certificate
from hfa_prove.check.loop_on_ball import LoopOnBall
from hfa_prove.check.region_squares import check_region
from hfa_prove.enclosure.ball_function import Undecided
from hfa_prove.enclosure.polynomial import Polynomial
from hfa_prove.fields import Rejected
from hfa_prove.monomials import PolynomialFunction, edge_points
from hfa_prove.problem import loop_at
from hfa_prove.search.clock import Clock
from hfa_prove.search.invariant import DisturbedLoop, invariant_region
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import LevelSet
from hfa_prove.search.region_search import Region
from hfa_prove.statements.loop import HIGHEST, LOWEST, Gain
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.region import RegionStatement
from hfa_support.errors import NoSolutionError
from hfa_support.progress import Progress
from trim.point.linearize import linearize
from trim.point.solve import trim

OF_CHECK = ("prove", "--aircraft", PENDULUM, "--check")
SIZE = 0.1


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory, model: Model) -> Path:
    """Return the path of a certificate of the pendulum under a disturbance."""
    path = tmp_path_factory.mktemp("invariant") / "pendulum.json"
    loop = replace(pendulum_loop(model), disturbances={"push": SIZE})
    return certified(path, loop, 0.72)


@pytest.fixture(scope="module")
def undisturbed() -> Region:
    """Return a region of the van der Pol oscillator without disturbance, for tests without a
    proof.
    """
    model = load_model(VAN_DER_POL)
    linear = linearize(model, trim(model))
    loop = loop_at(linear, Gain(np.zeros((0, 2))))
    known = PolynomialFunction.quadratic(solve_continuous_lyapunov(linear.A.T, -np.eye(2)))
    statement = RegionStatement.of_terms(loop, known.terms, 1.0, {})
    level_set = LevelSet(known, 1.0, known.coordinates())
    return Region(statement, {}, 1, level_set, {}, "given", LoopValues(loop))


def invariant(region: Region, progress: Progress | None = None) -> Region:
    """Return the largest set that is proved invariant under a push."""
    loop = replace(region.statement.loop, disturbances={"push": SIZE})
    return invariant_region(region, loop, Clock(60.0, progress))


def test_the_oscillators_invariant_set_has_known_size(undisturbed: Region) -> None:
    """The invariant set of the van der Pol oscillator under a bounded force has the known size.

    The lowest level at which V' >= 0 was found is less than 3 % above the proved level.
    """
    found = invariant(undisturbed)
    assert found.rise is not None
    assert found.set.rho < found.rise[0] < 1.03 * found.set.rho
    highest = {name: high for name, (_, high) in found.extents.items()}
    assert highest == pytest.approx({"position": 1.21, "velocity": 1.51}, abs=0.01)


@pytest.mark.slow
def test_the_best_v_of_the_search_is_used(undisturbed: Region) -> None:
    """Of the functions V in the search, the one that proves the largest invariant set is used."""
    flat = PolynomialFunction.quadratic(np.diag([1.0, 30.0]))
    better = PolynomialFunction.quadratic(np.array([[1.5, -0.5], [-0.5, 1.2]]))
    level_set = LevelSet(flat, 1.0, flat.coordinates())
    found = invariant(replace(undisturbed, set=level_set, tried=(better,)))
    assert found.origin == "a polynomial of degree 2 from the search"


def test_an_interruption_keeps_the_first_invariant_set(undisturbed: Region) -> None:
    """Ctrl-C ends the search after the V that is being tried. The set proved so far is returned."""
    tried = []

    def interrupt(done: float, whole: float, what: str = "", /) -> None:
        if what.startswith("proving"):
            tried.append(what)
        if len(tried) > 1:
            raise KeyboardInterrupt

    found = invariant(undisturbed, interrupt)
    assert found.stopped == "interrupted"
    assert len(tried) == 2


@pytest.mark.slow
def test_the_command_reports_the_invariant_set(tmp_path: Path) -> None:
    """The JSON of `hfa prove region` contains the disturbance and the proved level.

    The level is close to the level at which the decrease of V fails.
    """
    words = ("--disturbance", f"push={SIZE}", "--json")
    data = json.loads(quickly_proved(tmp_path / "pendulum.json", PENDULUM, *words))
    assert data["disturbances"] == {"push": SIZE}
    assert data["rho"] < data["decrease_fails_at"]["V"] < 1.2 * data["rho"]


def test_the_checker_reports_the_verified_claim(
    certificate: Path, model: Model, tmp_path: Path
) -> None:
    """The checker verifies six parts. The report states the disturbance and claims no
    convergence.
    """
    verified = check_certificate(certificate, model=model)
    # The torque free, at its lowest and at its highest value, the push at each of its ends.
    assert verified.size == 6
    written = tmp_path / "check.json"
    checked = hfa(*OF_CHECK, str(certificate), "-o", str(written))
    assert checked.code == 0
    assert json.loads(written.read_text())["schema"] == "hfa.region-check/1"
    shown = " ".join(checked.out.split())
    assert "|push| <= 0.1 N m" in shown
    assert "Convergence is not claimed" in shown
    assert "converges to the trim" not in shown


def test_no_trajectory_leaves_under_the_worst_disturbance(certificate: Path, model: Model) -> None:
    """No simulation from the boundary of the invariant set leaves it under the worst disturbance.

    Under a disturbance five times as large, a simulation leaves the set.
    """
    statement = check_certificate(certificate, model=model).statement
    T = V.coordinates()
    edge = edge_points(V, T, statement.rho)[::20] @ T.T
    assert _highest(DisturbedLoop(statement.loop, V), edge) <= statement.rho + 1e-9
    # Under a disturbance five times as large some leave it; the simulation detects this.
    larger = replace(statement.loop, disturbances={"push": 5 * SIZE})
    assert _highest(DisturbedLoop(larger, V), edge) > 1.1 * statement.rho


def _highest(plant: DisturbedLoop, starts: np.ndarray) -> float:
    """Return the largest V in simulations of 1.5 s by the classical Runge-Kutta method."""
    z = starts
    step = 0.01
    highest = 0.0
    for _ in range(150):
        k1 = plant.rates(z)
        k2 = plant.rates(z + step / 2 * k1)
        k3 = plant.rates(z + step / 2 * k2)
        k4 = plant.rates(z + step * k3)
        z = z + step / 6 * (k1 + 2 * k2 + 2 * k3 + k4)
        highest = max(highest, float(plant.V(z).max()))
    return highest


def test_the_worst_disturbance_maximizes_the_rate(certificate: Path, model: Model) -> None:
    """The disturbance of the search has the sign that maximizes V', and the effect of the
    analytical model.
    """
    loop = check_certificate(certificate, model=model).statement.loop
    other = PolynomialFunction.quadratic(np.array([[2.0, 0.3], [0.3, 0.5]]))
    z = np.random.default_rng(0).normal(size=(50, 2))
    moved = DisturbedLoop(loop, other).rates(z) - LoopValues(loop).rates(z)
    # m l² of the example.
    assert np.allclose(moved[:, 0], 0.0)
    assert np.allclose(moved[:, 1], np.sign(other.slope(z)[:, 1]) * SIZE / (0.15 * 0.5**2))


def test_forgeries_are_refused(certificate: Path, model: Model) -> None:
    """A forgery of each kind is refused."""
    kinds = set(KINDS | DISTURBED_KINDS)
    assert accepted_forgeries(certificate, model, len(kinds)) == (kinds, [])


@pytest.mark.slow
def test_a_thousand_forgeries_are_refused(certificate: Path, model: Model) -> None:
    """One thousand forgeries of all kinds are refused."""
    kinds = set(KINDS | DISTURBED_KINDS)
    assert accepted_forgeries(certificate, model, 1000, seed=1) == (kinds, [])


def test_boundary_evidence_without_disturbances_is_refused(certificate: Path, model: Model) -> None:
    """Evidence for V' < 0 where V = rho is refused for a loop without disturbances.

    Such evidence does not prove convergence.
    """
    content = json.loads(certificate.read_text())
    content["statement"]["loop"]["disturbances"] = {}
    for part in content["witness"]["parts"]:
        del part["inputs"][-1]
    with pytest.raises((Rejected, NoSolutionError), match="edge"):
        check_region(*read_content(content, Subject(model)))


_MODELS = """
import casadi as ca
from hfa import Model, Signal

def squared(x, u, p, w):
    return {"a": u.b - x.a + w.gust**2}, {}

def stepped(x, u, p, w):
    return {"a": u.b - x.a + 100 * x.a * (w.gust <= 0.05) * (-0.05 <= w.gust)}, {}

def seen(x, u, p, w):
    return {"a": u.b - x.a + w.gust}, {"load": x.a + 10 * w.gust}

GUST = {"gust": Signal("m/s", 1.0)}
A = {"a": Signal(max=3, min=-3)}
B = {"b": Signal()}
SQUARED = Model("squared", A, B, squared, disturbances=GUST, trim={"a": 0.0})
STEPPED = Model("stepped", A, B, stepped, disturbances=GUST, trim={"a": 0.0})
LOAD = {"load": Signal(min=-2, max=2)}
SEEN = Model("seen", A, B, seen, disturbances=GUST, outputs=LOAD, trim={"a": 0.0})
"""


def _loop(folder: Path, name: str, size: float) -> LoopOnBall:
    """Return the loop of a model with one state, V = a², on the ball |a| <= 1.

    size: largest absolute value of the gust
    """
    from hfa_prove.statements.loop import Loop

    source = folder / "models.py"
    source.write_text(_MODELS)
    model = load_model(f"{source}:{name}")
    limits = {"a": (-3.0, 3.0)}
    if "load" in model.outputs:
        limits["load"] = (-2.0, 2.0)
    K = np.array([[1.0]])
    loop = Loop(model, {}, {"a": 0.0}, {"b": 0.0}, {}, limits, Gain(K), {"gust": size})
    statement = RegionStatement.of_terms(loop, ((1.0, (2,)),), 1.0, {"a": (-1.1, 1.1)})
    return LoopOnBall(statement, np.eye(1), 4)


def test_rates_not_affine_name_the_disturbance(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Rates that are not affine in a disturbance are refused by the name of the disturbance.

    A name that is not a disturbance is refused too.
    """
    source = tmp_path / "models.py"
    source.write_text(_MODELS)
    words = ["prove", "region", "--aircraft", f"{source}:SQUARED", "--disturbance"]
    assert main([*words, "gust=0.1"]) == 2
    assert "not affine in gust" in capsys.readouterr().err
    assert main([*words, "rain=0.1"]) == 2
    assert "declares no disturbance" in capsys.readouterr().err


def test_steps_between_ends_of_disturbances_are_detected(tmp_path: Path) -> None:
    """Steps and limits between the ends of a disturbance are detected."""
    part = {"b": "free", "gust": HIGHEST}
    # The step is between the ends -0.1 and 0.1, not at them.
    with pytest.raises(Undecided):
        _loop(tmp_path, "STEPPED", 0.1).rates(part)
    rates = _loop(tmp_path, "SEEN", 0.05).rates(part)
    assert rates[0].center.contains(arb(0.05))
    with pytest.raises(Rejected, match="load is not proved to stay within its limits"):
        _loop(tmp_path, "SEEN", 0.15).rates(part)


def test_rates_at_ends_of_disturbance_are_exact(certificate: Path, model: Model) -> None:
    """Rates at the two ends of the disturbance differ by its analytical effect."""
    content = json.loads(certificate.read_text())
    statement, witness = read_content(content, Subject(model))
    loop = LoopOnBall(statement, witness.T, witness.order)
    low = loop.rates({"torque": "free", "push": LOWEST})[1]
    high = loop.rates({"torque": "free", "push": HIGHEST})[1]
    difference = (high - low).polynomial - Polynomial.constant(arb(2 * SIZE) / (0.15 * 0.5**2))
    assert all(abs(coefficient) < 1e-10 for _, _, coefficient in difference.terms())
