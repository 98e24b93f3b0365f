"""Each option of a command `hfa prove STATEMENT` reaches the computation, and so does its default.

The searches are replaced by a function that records its arguments.
"""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from as_proved import as_proved
from cli import answer, hfa
from nominal import nominal_game
from pendulum_deployment import pendulum_deployment
from proof_cases import PLANT
from small_networks import imitation
from stored_certificates import ROOT, pendulum, read, stored

import hfa as package
from hfa import Model, Signal
from hfa.paper import default_parameters, published_game
from hfa_prove import Family
from hfa_prove.commands.region import _same_loop
from hfa_prove.search.obstacles import Obstacles
from hfa_prove.search.region import region_of_certificate
from hfa_support.errors import NoSolutionError

PENDULUM = ("--aircraft", f"{ROOT}/examples/pendulum.py:PENDULUM")
GTM = ("--aircraft", f"{ROOT}/examples/gtm.py:GTM")
#: An aircraft whose scheduling variable is an angle.
SWEPT = """
import math
from hfa import Model, Signal

SWEPT = Model(
    "swept", {"x": Signal("m")}, {"u": Signal("N")},
    lambda x, u, p, w: ({"x": u.u - p.sweep * x.x}, {}),
    parameters={"sweep": Signal("rad", start=math.radians(15.0))}, schedule="sweep",
    trim={"x": 0.0},
)
"""
Run = Callable[..., dict[str, Any]]


@pytest.fixture
def run(monkeypatch: pytest.MonkeyPatch) -> Run:
    """Return a function that runs a command and returns the arguments of its search by name.

    Positional arguments have the names 0, 1, ...
    """

    def recorded(search: str, *words: str) -> dict[str, Any]:
        found: list[dict[str, Any]] = []

        def record(*given: Any, **named: Any) -> Any:
            found.append({str(i): each for i, each in enumerate(given)} | named)
            raise NoSolutionError("recorded")

        monkeypatch.setattr(f"hfa_prove.search.{search}", record)
        result = hfa("prove", *words)
        assert (result.code, "recorded" in result.err) == (1, True), result.err
        (arguments,) = found
        return arguments

    return recorded


def test_options_of_a_schedule_reach_the_proof(run: Run, tmp_path: Path) -> None:
    """Interval, gains, intervals of actuators, parameters and file are those of the options."""
    name = "schedule.prove_schedule"
    words = ("schedule", "--dihedral", "14:14.125")

    def loop_of(*options: str) -> Any:
        return run(name, *words, *options)["1"]

    plain = run(name, *words)
    assert (plain["2"], plain["3"], plain["moving"], plain["file"]) == (14.0, 14.125, False, None)
    assert plain["1"].actuators is None
    assert plain["0"].spread == {}
    assert run(name, *words, "--rate")["moving"] is True
    model = package.aircraft()
    for options, changed in (
        ((), {}),
        (("--delta", "150"), {"delta": 150.0}),
        (("--Q", "1,2,3,4,5,6"), {"Q": np.diag([1.0, 2.0, 3.0, 4.0, 5.0, 6.0])}),
        (("--R", "1,2,3,4,5"), {"R": np.diag([1.0, 2.0, 3.0, 4.0, 5.0])}),
    ):
        linear = package.linearize(model, package.trim(model, at=np.radians(14.0)))
        game = replace(published_game(linear), **changed)
        K = package.solve(game).K
        controller = loop_of(*options).controller
        assert controller.breakpoints[0] == 14.0
        assert np.allclose(-controller.D[0], K, rtol=1e-6, atol=1e-9)
    for options, bandwidth, effectiveness, delay in (
        (("--bandwidth", "2:9"), (2.0, 9.0), (1.0, 1.0), 0.0),
        (("--bandwidth", "5"), (5.0, 5.0), (1.0, 1.0), 0.0),
        (("--bandwidth", "2:9", "--effectiveness", "0.5:0.75"), (2.0, 9.0), (0.5, 0.75), 0.0),
        (("--bandwidth", "2:9", "--delay", "0.125"), (2.0, 9.0), (1.0, 1.0), 0.125),
    ):
        actuators = loop_of(*options).actuators
        assert actuators.bandwidth == bandwidth
        assert (actuators.effectiveness, actuators.delay) == (effectiveness, delay)
    for options, factor, changed in (
        ((), 300.0, {}),
        (("--R", "1,2,3,4,5"), 1.0, {"R": np.diag([1.0, 2.0, 3.0, 4.0, 5.0])}),
        (("--delta", "5000"), 300.0, {"delta": 5000.0}),
    ):
        controller = loop_of("--bandwidth", "2:9", *options).controller
        game = with_slow_actuators(replace(published_game(linear), **changed), 2.0, factor)
        K = package.solve(replace(game, delta=changed.get("delta", np.inf))).K
        assert np.allclose(-controller.D[0], K, rtol=1e-5, atol=1e-8)
    wider = run(name, "schedule", "--dihedral", "14:19")["1"].controller  # at most 2 deg apart
    assert wider.breakpoints == pytest.approx(np.linspace(14.0, 19.0, 4))
    for breakpoint, D in zip(wider.breakpoints, wider.D, strict=True):
        at = package.linearize(model, package.trim(model, at=np.radians(breakpoint)))
        assert np.allclose(-D, package.solve(published_game(at)).K, rtol=1e-6, atol=1e-9)
    wide = run(name, *words, "--error", "2")["0"].spread
    errors = default_parameters().standard_errors
    assert wide == pytest.approx({each: 2.0 * error for each, error in errors.items() if error})
    assert run(name, *words, "--hold", "speed=70")["0"].flights != plain["0"].flights
    assert run(name, *words, "--dynamics", "newton")["0"].model.name == "newton"
    own = run(name, "schedule", *GTM, "--at", "40:41")
    assert (own["0"].model.name, own["2"], own["3"]) == ("GTM", 40.0, 41.0)
    table = tmp_path / "table.npz"
    K = np.arange(60.0).reshape(2, 5, 6)
    np.savez(table, dihedral_deg=[14.0, 14.5], K=K)
    controller = loop_of("--weights", str(table)).controller
    assert np.array_equal(-controller.D, K)
    assert controller.breakpoints.tolist() == [14.0, 14.5]
    file = run(name, *words, "-o", str(tmp_path / "proof.json"))["file"]
    assert file.path == tmp_path / "proof.json"


def with_slow_actuators(game: package.Game, w: float, factor: float) -> package.Game:
    """Return the game of a plant with actuators a' = w (u - a), with R multiplied by a factor."""
    n, m = game.B.shape
    eye = np.eye(m)
    A = np.block([[game.A, game.B], [np.zeros((m, n)), -w * eye]])
    B = np.vstack([np.zeros((n, m)), w * eye])
    return package.Game(A, B, np.eye(n + m), np.pad(game.Q, (0, m)), factor * game.R, np.inf)


def test_the_unit_of_widths_follows_the_scheduling_variable() -> None:
    """1 deg for an angle, and the power of two nearest to π / 180 nominal values otherwise."""
    assert Family(package.aircraft()).step == 1.0
    for nominal, step in ((45.0, 1.0), (100.0, 2.0), (20.0, 0.25)):
        model = Model(
            "plant", {"x": Signal()}, {}, lambda x, u, p, w: ({"x": -p.p * x.x}, {}),
            parameters={"p": Signal(nominal=nominal, start=1.0)}, schedule="p", trim={},
        )  # fmt: skip
        assert Family(model).step == step


def test_options_of_a_region_reach_the_search(run: Run, tmp_path: Path) -> None:
    """Policy, degree, time, provers and disturbances are those of the options."""
    name = "region.proved_region"
    words = ("region", *PENDULUM)
    model = pendulum()
    linear = package.linearize(model, package.trim(model))

    def gain_of(*options: str) -> Any:
        return run(name, *words, *options)["0"].loop.policy

    plain = run(name, *words)
    assert plain["1"] == ("squares", "boxes")
    assert (plain["degree"], plain["seconds"], plain["earlier"]) == (4, 60.0, None)
    loop = plain["0"].loop
    assert (loop.disturbances, loop.limits) == ({}, {"torque": (-0.7, 0.7)})
    solution = package.solve(nominal_game(linear))
    assert np.allclose(gain_of().K, solution.K)
    ((said, P),) = plain["0"].known
    assert (said, P) == ("P of the game", pytest.approx(solution.P))
    assert run(name, *words, "--degree", "6")["degree"] == 6
    assert run(name, *words, "--seconds", "7")["seconds"] == 7.0
    assert run(name, *words, "--prover", "boxes")["1"] == ("boxes",)
    disturbed = run(name, *words, "--disturbance", "push=0.125")
    assert disturbed["0"].loop.disturbances == {"push": 0.125}
    assert disturbed["1"] == ("squares",)
    for options, changed in (
        (("--Q", "4,5"), {"Q": np.diag([4.0, 5.0])}),
        (("--R", "3"), {"R": [[3.0]]}),
    ):
        game = replace(nominal_game(linear), **changed)
        assert np.allclose(gain_of(*options).K, package.solve(game).K)
    weights = tmp_path / "weights.npz"
    np.savez(weights, K=[[2.0, 1.5]])
    assert gain_of("--weights", str(weights)).K.tolist() == [[2.0, 1.5]]
    np.savez(weights, W=[1.0, 2.0, 3.0, 0.5])
    terms = gain_of("--weights", str(weights), "--basis", "x1**2, x1*x2, x2**2, x2**4").terms
    (((coefficient, powers),),) = terms.values()
    assert (coefficient, powers) == (pytest.approx(-2.0 * 0.5 * linear.B[1, 0]), (0, 3))
    network = imitation(tmp_path / "network.npz", solution.K, np.array([0.5, 3.0]), hidden=(3,))
    of_network = ("--weights", str(network), "--set", "activation=tanh")
    found = run(name, *words, *of_network)
    assert (found["degree"], found["1"]) == (2, ("boxes",))
    assert [said for said, _ in found["0"].known] == ["P of the game"]
    assert run(name, *words, *of_network, "--degree", "4")["degree"] == 4
    deployed = pendulum_deployment(tmp_path, "[timing]\ndt = 0.02\n")
    found = run(name, *words, "--policy", str(deployed))
    assert (found["degree"], found["1"]) == (2, ("boxes",))
    for options, reason in (
        (("--disturbance", "push=1", "--prover", "boxes"), "boxes does not support a disturbance"),
        ((*of_network, "--prover", "squares"), "squares does not support a network"),
        ((*of_network, "--disturbance", "push=1"), "cannot be combined with a network"),
    ):
        refused = hfa("prove", *words, *options)
        assert (refused.code, reason in refused.err) == (2, True), refused.err


def test_a_found_region_is_written_shown_and_resumed(
    run: Run, folder: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """-o writes the certificate of the found region, from which --resume continues.

    The certificate of another loop or of another prover is not resumed.
    """
    statement, witness = read(stored("region"))
    proved = as_proved(statement, witness, (3,))
    found = replace(
        region_of_certificate(proved, stored("region")["witness"]),
        obstacles=Obstacles((np.inf, None), {}, ("torque",)),
    )
    monkeypatch.setattr("hfa_prove.search.region.proved_region", lambda *given, **named: found)
    words = ("region", *PENDULUM)
    shown = answer("prove", *words)
    assert list(folder.iterdir()) == []
    assert (shown["rho"], shown["limits_that_bind"]) == (statement.rho, ["torque"])
    assert answer("prove", *words, "-o", "region.json")["rho"] == statement.rho
    written = json.loads(Path("region.json").read_text())
    for part in ("kind", "statement", "witness"):
        assert written[part] == stored("region")[part]
    assert "-o region.json" in written["provenance"]["command"]
    checked: list[Path] = []

    def check(path: Path, *others: Any) -> Any:
        checked.append(path)
        return proved

    monkeypatch.setattr("hfa_prove.check.check_certificate", check)
    resumed = (*words, "-o", "region.json", "--resume")
    earlier = run("region.proved_region", *resumed)["earlier"]
    assert (earlier.rho, earlier.prover) == (statement.rho, "squares")
    for options, reason in (
        (("--Q", "4,5"), "the certificate of another loop"),
        (("--prover", "boxes"), "is proved by squares"),
    ):
        refused = hfa("prove", *resumed, *options)
        assert (refused.code, reason in refused.err) == (2, True), refused.err
    assert checked == [Path("region.json")] * 3
    loop = statement.loop
    for other in ("parameters", "trim", "inputs", "held", "disturbances"):
        assert not _same_loop(loop, replace(loop, **{other: {"other": 0.5}})), other


def test_options_of_a_bound_reach_the_search(run: Run) -> None:
    """Degree, margin, time, weights and limits are those of the options."""
    name = "cost.bound_search"
    words = ("cost", *PENDULUM)
    plain = run(name, *words)
    assert (plain["degree"], plain["margin"], plain["seconds"]) == (4, 0.02, 120.0)
    assert np.array_equal(plain["0"].Q, np.eye(2))
    assert run(name, *words, "--degree", "12")["degree"] == 12
    assert run(name, *words, "--margin", "0.125")["margin"] == 0.125
    assert run(name, *words, "--seconds", "3")["seconds"] == 3.0
    assert np.array_equal(run(name, *words, "--Q", "4,5")["0"].Q, np.diag([4.0, 5.0]))
    assert np.array_equal(run(name, *words, "--R", "3")["0"].R, [[3.0]])
    limited = run(name, *words, "--limit", "angle=-20:30")["0"].envelope
    ends = {
        n: (a, b) for n, a, b in zip(limited.names, limited.lowest, limited.highest, strict=True)
    }
    assert ends["angle"] == pytest.approx((np.radians(-20.0), np.radians(30.0)))


def test_the_scheduling_value_of_a_game_is_that_of_the_option(run: Run, tmp_path: Path) -> None:
    """An angle is given in degrees; by default, the value is the one held or that of the trim."""
    name = "game.prove_solution"
    swept = tmp_path / "swept.py"
    swept.write_text(SWEPT)
    for words, value in (
        (("--dihedral", "15"), 15.0),
        ((*GTM, "--at", "40"), 40.0),
        ((*GTM, "--hold", "speed=42"), 42.0),
        (GTM, 45.0),
        (("--aircraft", f"{swept}:SWEPT"), 15.0),
        (("--aircraft", f"{swept}:SWEPT", "--at", "20"), 20.0),
    ):
        found = run(name, "solution", *words)
        assert found["2"] == pytest.approx(value, rel=1e-12)
        own = {"--dihedral": "published", GTM[1]: "GTM"}
        assert found["1"].model.name == next((own[each] for each in words if each in own), "swept")
    found = run(name, "solution", "--dihedral", "15", "--delta", "150")
    assert found["0"].delta == 150.0
    model = package.aircraft()
    linear = package.linearize(model, package.trim(model, at=np.radians(15.0)))
    assert np.allclose(found["0"].A, linear.A)
    plant = tmp_path / "plant.npz"
    parts = {part: getattr(PLANT, part) for part in ("A", "B", "E", "Q", "R")}
    np.savez(plant, **parts)
    found = run(name, "solution", "--model", str(plant), "--delta", "50")
    assert (found["1"], found["2"], found["0"].delta) == (None, None, 50.0)
    critic = tmp_path / "critic.npz"
    np.savez(critic, W=[1.0, 2.0, 3.0])
    found = run("game.prove_critic", "critic", str(critic), "--model", str(plant), "--delta", "50")
    assert np.allclose(found["1"].P, [[1.0, 1.0], [1.0, 3.0]])
    assert found["2"] is None


def test_the_degree_of_a_value_is_that_of_the_option(run: Run) -> None:
    """The degree is 4 by default."""
    for options, order in (((), 4), (("--order", "3"), 3)):
        found = run("value.prove_value", "value", *PENDULUM, *options)
        assert found["0"].order == order
        assert found["1"].model.name == "pendulum"
