"""Each field of a region's statement is compared with the user's input, or printed."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest
from pendulum_regions import PENDULUM, certified, pendulum_loop

import hfa
from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.march.ending import Outcome
from hfa_aircraft.model import Model, Signal
from hfa_prove.check import check_certificate
from hfa_prove.check.region_squares import extents_of
from hfa_prove.problem import loop_at
from hfa_prove.report_region import checked_report
from hfa_prove.search.clock import Clock
from hfa_prove.search.loop_values import LoopValues
from hfa_prove.search.obstacles import outcomes
from hfa_prove.statements.loop import Gain, Loop

Content = dict[str, Any]


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory, model: Model) -> Path:
    """Return the path of a certificate of the pendulum."""
    folder = tmp_path_factory.mktemp("fields")
    return certified(folder / "pendulum.json", pendulum_loop(model), 0.98)


def test_the_first_line_names_missing_subjects(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The first line names a policy that is not given. A given policy that differs is refused."""
    words = ["prove", "--check", str(path), "--aircraft", PENDULUM, "-q"]
    assert main(words) == 0
    first = " ".join(capsys.readouterr().out.split("\n\n")[0].split())
    limits = "without sampling, delay, actuators, disturbances"
    assert f"of the policy in the certificate, {limits}" in first
    assert main([*words, "--delta", "inf"]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "of the policy in the certificate" not in out
    assert limits in out
    assert "The given policy agrees with it to 1e-09 of its largest entry." in out
    assert main([*words, "--Q", "4,4"]) == 1
    assert "K in the certificate differs from the value of the game" in capsys.readouterr().err
    assert main([*words, "--degree", "2"]) == 2


HEAVIER = """
import casadi as ca
from hfa import Model, Signal

def swing(x, u, p, w):
    moment = u.torque + 0.15 * p.gravity * 0.5 * ca.sin(x.angle) - 0.1 * x.rate
    return {"angle": x.rate, "rate": moment / (0.15 * 0.5**2)}, {}

SWING = Model(
    "swing", {"angle": Signal("rad"), "rate": Signal("rad/s")},
    {"torque": Signal("N m", 1.0, -0.7, 0.7)}, swing,
    parameters={"gravity": Signal("m/s^2", 9.81, start=9.81)}, trim={"angle": 0.0, "rate": 0.0},
)
"""


def test_parameters_of_another_aircraft_are_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Parameters that differ from the user's are refused, although the file's hash is equal.

    With the stated parameters given by --hold, the certificate is accepted.
    """
    file = tmp_path / "swing.py"
    file.write_text(HEAVIER)
    aircraft = f"{file}:SWING"
    lighter = pendulum_loop(load_model(aircraft).with_parameters(gravity=5.0))
    made = str(certified(tmp_path / "lighter.json", lighter, 0.5))
    capsys.readouterr()
    assert main(["prove", "--check", made, "--aircraft", aircraft, "-q"]) == 1
    assert (
        "gravity in the certificate differs from the value of --aircraft" in capsys.readouterr().err
    )
    words = ["prove", "--check", made, "--aircraft", aircraft, "--hold", "gravity=5", "-q"]
    assert main(words) == 0
    assert "gravity 5 m/s^2" in " ".join(capsys.readouterr().out.split())


def test_printed_extents_are_those_of_the_ellipse(path: Path, model: Model) -> None:
    """The printed extents are those of the proved ellipse, also if the stated extents are wider."""
    verified = check_certificate(path, model=model)
    P = np.array(checked_report(verified).data["P"])
    ends = np.sqrt(verified.statement.rho * np.diag(np.linalg.inv(P)))
    extents = extents_of(verified.statement, verified.witness.T)
    for (low, high), end in zip(extents.values(), ends, strict=True):
        assert high == -low == pytest.approx(end, rel=1e-12)
        assert high >= end


def test_outcomes_of_trajectories_are_distinguished() -> None:
    """Trajectories of a double integrator have the outcomes RETURNED, UNKNOWN and LEFT.

    RETURNED: convergence within the time. UNKNOWN: convergence after the time. LEFT: a limit is
    exceeded.
    """

    def two(x: Any, u: Any, p: Any, w: Any) -> Any:
        return {"x": x.v, "v": u.a}, {}

    inputs = {"a": Signal("1", 1.0, -1.0, 1.0)}
    free = Model("two", {"x": Signal(), "v": Signal()}, inputs, two, trim={"a": 0.0})
    limited = {"x": Signal(min=-50.0, max=50.0), "v": Signal()}
    kept = Model("two", limited, inputs, two, trim={"a": 0.0})
    starts = np.array([[40.0, 0.0], [49.0, 9.0]])

    def found(model: Model, seconds: float) -> list[int]:
        values = {"x": 0.0, "v": 0.0}
        linear = hfa.linearize(model, hfa.trim(model, hold=values))
        loop = loop_at(linear, Gain(np.array([[1.0, 2.0]])))
        return outcomes(LoopValues(loop), starts, _is_near, seconds, Clock(60.0)).tolist()

    assert found(free, 100.0) == [Outcome.CONVERGED, Outcome.CONVERGED]
    assert found(free, 3.0) == [Outcome.UNDECIDED, Outcome.UNDECIDED]
    assert found(kept, 100.0) == [Outcome.CONVERGED, Outcome.LEFT]


def test_a_distant_initial_condition_converges() -> None:
    """x' = -x converges from 1e35 nominal values. The distance is not counted as divergence."""
    model = Model("one", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": -x.x}, {}), trim={})
    loop = Loop(model, {}, {"x": 0.0}, {}, {}, {}, Gain(np.zeros((0, 1))))
    found = outcomes(LoopValues(loop), np.array([[1e35]]), _is_near, 100.0, Clock(60.0))
    assert found.tolist() == [Outcome.CONVERGED]


def _is_near(z: np.ndarray) -> np.ndarray:
    return np.asarray(np.all(np.abs(z) < 0.5, axis=1))


def test_a_fully_stated_trim_is_accepted(model: Model) -> None:
    """A trim in which all values are held is accepted if it is an equilibrium, and refused
    otherwise.
    """
    stated = {"angle": 0.0, "rate": 0.0, "torque": 0.0}
    point = hfa.trim(model, hold=stated)
    assert point.values == stated
    holds = [word for name in stated for word in ("--hold", f"{name}=0")]
    assert main(["trim", "--aircraft", PENDULUM, *holds, "-q"]) == 0
    with pytest.raises(hfa.BadInputError, match="not an equilibrium"):
        hfa.trim(model, hold=stated | {"angle": 0.1})
