"""Regions of small loops: proved, checked, forged and simulated."""

from __future__ import annotations

import json
import os
import signal
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import SCRIPT
from ended_runs import until
from forged_regions import KINDS
from pendulum_regions import (
    PENDULUM,
    VAN_DER_POL,
    accepted_forgeries,
    certified,
    pendulum_loop,
    quickly_proved,
)

from hfa.main import main
from hfa_aircraft.march.ending import Outcome
from hfa_aircraft.model import Model, Signal
from hfa_prove.check import check_certificate
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.report_region import region_report
from hfa_prove.search.clock import Clock
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import outcomes
from hfa_prove.search.region import proved_region
from hfa_prove.search.region_search import Region, RegionProblem
from hfa_prove.statements.loop import Gain, Loop
from hfa_prove.statements.region import RegionStatement
from hfa_support.interruption import interruptible


def run(*words: str) -> int:
    return main(["prove", "region", *words])


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory, model: Model) -> Path:
    """Return the path of a certificate of the pendulum."""
    path = tmp_path_factory.mktemp("region") / "pendulum.json"
    return certified(path, pendulum_loop(model), 0.98)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("aircraft", "states"),
    [
        (VAN_DER_POL, ["position", "velocity"]),
        (PENDULUM, ["angle", "rate"]),
    ],
)
def test_the_level_is_bounded_by_found_obstacles(
    aircraft: str, states: list[str], tmp_path: Path
) -> None:
    """The JSON of `hfa prove region` contains the proved level.

    The level is at most 6 % below the level where V' >= 0 was found.
    """
    picture = tmp_path / "region.png"
    printed = quickly_proved(
        tmp_path / "region.json", aircraft, "--json", "--picture", str(picture)
    )
    data = json.loads(printed)
    assert picture.stat().st_size > 10_000
    assert data["proved"] is True
    assert data["states"] == states
    assert np.array(data["P"]).shape == (2, 2)
    # V' >= 0 was found beyond the level that is proved, and not far beyond it.
    fails_at = data["decrease_fails_at"]["V"]
    assert data["rho"] < fails_at < 1.06 * data["rho"]
    assert data["lost_at"]["V"] > data["rho"]
    assert data["limits_that_bind"] == []
    assert list(data["extents"]) == states


# The pendulum.


def test_a_certificate_is_checked_and_reported(
    certificate: Path, model: Model, capsys: pytest.CaptureFixture[str]
) -> None:
    """A certificate is verified with three parts, and the report shows the input limit."""
    verified = check_certificate(certificate, model=model)
    assert verified.size == 3
    assert main(["prove", "--aircraft", PENDULUM, "--check", str(certificate)]) == 0
    shown = capsys.readouterr().out
    assert "Verified, proved" in shown
    assert "-0.7 N m" in shown


def test_a_certificate_of_another_aircraft_is_refused(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A certificate is refused for another aircraft and without an aircraft."""
    assert run("--aircraft", VAN_DER_POL, "--check", str(certificate)) == 2
    assert run("--check", str(certificate)) == 2
    assert "--aircraft" in capsys.readouterr().err


@pytest.mark.slow
def test_flights_from_the_proved_set_converge(certificate: Path, model: Model) -> None:
    """All flights from the proved set converge. From four times as far, some do not."""
    statement = check_certificate(certificate, model=model).statement
    V = PolynomialFunction.of_terms(statement.terms)
    assert not _not_converged(statement, V, 400).any()
    # Four times as far out, some do not converge; the simulation detects this.
    assert _not_converged(statement, V, 200, farther=4.0).any()


def _not_converged(
    statement: RegionStatement, V: PolynomialFunction, count: int, farther: float = 1.0
) -> np.ndarray:
    generator = np.random.default_rng(3)
    L = np.linalg.cholesky(V.matrix())
    directions = generator.normal(size=(count, len(L)))
    rays = np.linalg.solve(L.T, directions.T).T
    starts = rays * np.sqrt(statement.rho / V(rays))[:, None]
    starts *= farther * generator.uniform(0.0, 1.0, (count, 1)) ** (1 / len(L))

    def near(z: np.ndarray) -> np.ndarray:
        return V(z) <= 1e-4 * statement.rho

    return (
        outcomes(LoopValues(statement.loop), starts, near, 20.0, Clock(60.0)) != Outcome.CONVERGED
    )


@pytest.mark.slow
def test_a_search_resumes_from_its_certificate(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A resumed search begins with V of the certificate.

    A certificate of another loop is refused.
    """
    again = tmp_path / "again.json"
    again.write_text(certificate.read_text())
    words = ("--aircraft", PENDULUM, "--degree", "2", "--seconds", "0.001", "--json", "--resume")
    assert run(*words, "-o", str(again)) == 0
    assert json.loads(capsys.readouterr().out)["origin"] == "V of the certificate"
    assert run(*words, "--Q", "5,5", "-o", str(again)) == 2
    assert "another loop" in capsys.readouterr().err


# Interrupted.


def test_an_interrupted_search_reports_its_region() -> None:
    """Ctrl-C ends the search, and the region proved so far is reported."""
    sink = Model("sink", {"x": Signal(min=-1.0, max=1.0)}, {}, _cubic, trim={"x": 0.0})
    loop = Loop(sink, {}, {"x": 0.0}, {}, {}, {"x": (-1.0, 1.0)}, Gain(np.zeros((0, 1))))
    before = signal.getsignal(signal.SIGINT)
    saved: list[Region] = []

    def interrupt(done: float, whole: float, what: str = "", /) -> None:
        if saved:
            os.kill(os.getpid(), signal.SIGINT)

    with interruptible(interrupt) as progress:
        found = proved_region(
            RegionProblem(loop),
            ("squares",),
            degree=6,
            seconds=600.0,
            progress=progress,
            save=saved.append,
        )
    assert signal.getsignal(signal.SIGINT) is before
    assert found.statement is saved[-1].statement
    report = region_report(found)
    assert "No larger set is proved: interrupted." in report.text()
    assert report.data["stopped"] == "interrupted"


def _cubic(x: Any, u: Any, p: Any, w: Any) -> Any:
    """Equations x' = -x + x³, for which V = x² decreases where |x| < 1."""
    return {"x": -x.x + x.x**3}, {}


@pytest.mark.slow
def test_an_interrupted_command_ends_like_a_timeout(tmp_path: Path) -> None:
    """An interrupted command ends with exit code 0.

    Its certificate is valid, and the search can be resumed from it.
    """
    words = ["prove", "region", "--aircraft", PENDULUM, "--prover", "squares"]
    words += ["--seconds", "600", "-o", "region.json"]
    process = subprocess.Popen(
        [SCRIPT, *words],
        cwd=tmp_path,
        stdout=subprocess.PIPE,
        stderr=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    certificate = tmp_path / "region.json"
    assert until(certificate.exists)
    process.send_signal(signal.SIGINT)
    out, err = process.communicate(timeout=120)
    assert (process.returncode, err) == (0, "wrote region.json\n")
    assert "No larger set is proved: interrupted." in out
    assert main(["prove", "--aircraft", PENDULUM, "--check", str(certificate)]) == 0
    assert run(*words[2:-4], "--seconds", "0.1", "--resume", "-o", str(certificate)) == 0


# Other loops.


def test_unsupported_loops_are_refused(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """Unstable loops and equations with unsupported operations are refused."""
    assert run("--aircraft", PENDULUM.replace(":PENDULUM", ":STAR")) == 1
    assert "not Hurwitz" in capsys.readouterr().err
    kinked = tmp_path / "kinked.py"
    kinked.write_text(_KINKED)
    assert run("--aircraft", f"{kinked}:ERROR", "--prover", "squares") == 2
    assert "use erf" in capsys.readouterr().err


@pytest.mark.slow
@pytest.mark.parametrize("name", ["KINK", "SWITCH", "TABLE"])
def test_regions_end_before_a_switch(
    name: str, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A switch, a kink or a breakpoint of a table at a = 1 bounds the region of sums of squares."""
    kinked = tmp_path / "kinked.py"
    kinked.write_text(_KINKED)
    assert run("--aircraft", f"{kinked}:{name}", "--prover", "squares", "--json") == 0
    assert 0.9 < json.loads(capsys.readouterr().out)["extents"]["a"] < 1.0


_KINKED = """
import casadi as ca
from hfa import Model, Signal

TABLED = ca.interpolant("tabled", "linear", [[-9.0, 1.0, 9.0]], [-9.0, 1.0, 2.0])


def of(name, force):
    def equations(x, u, p, w):
        return {"a": u.b - x.a - force(x.a)}, {}

    return Model(name, {"a": Signal(max=3, min=-3)}, {"b": Signal()}, equations, trim={"a": 0.0})


SWITCH = of("switch", lambda a: a * ca.if_else(a > 1, 2, 1))
KINK = of("kink", lambda a: 1 - ca.fabs(a - 1))
TABLE = of("table", TABLED)
ERROR = of("error", ca.erf)
"""


@pytest.mark.slow
def test_two_thousand_forgeries_are_refused(certificate: Path, model: Model) -> None:
    """Two thousand forgeries of all kinds are refused."""
    assert accepted_forgeries(certificate, model, 2000, seed=1) == (set(KINDS), [])
