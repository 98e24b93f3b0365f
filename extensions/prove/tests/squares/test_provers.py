"""Provers of `hfa prove region`: the choice between them, and proofs of gains on boxes."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from types import SimpleNamespace
from typing import Any, cast

import numpy as np
import pytest
from as_proved import as_proved
from first_proofs import first_region
from pendulum_regions import pendulum_loop
from stored_certificates import read, stored

from hfa.main import main
from hfa_aircraft.loading import load_model
from hfa_aircraft.model import Model, Signal
from hfa_prove.certificate import write_certificate
from hfa_prove.monomials import PolynomialFunction
from hfa_prove.search import region as searches
from hfa_prove.search.clock import Clock
from hfa_prove.search.obstacles import LevelSet
from hfa_prove.search.region import proved_region, region_of_certificate
from hfa_prove.search.region_search import Region, RegionProblem, Settings
from hfa_prove.statements.loop import Gain, Loop
from hfa_support.errors import NoSolutionError

PENDULUM = "examples/pendulum.py:PENDULUM"
VAN_DER_POL = "examples/pendulum.py:VAN_DER_POL"
KINKED = """
import casadi as ca
from hfa import Model, Signal

def equations(x, u, p, w):
    spring = ca.if_else(x.angle < 0.4, 1.2 * x.angle, 0.48 + 0.5 * (x.angle - 0.4))
    damping = 0.2 * x.rate + 0.3 * ca.fmax(x.rate - 0.5, 0)
    return {"angle": x.rate, "rate": 3 * ca.sin(x.angle) - spring - damping + 8 * u.torque}, {}

KINKED = Model(
    "kinked pendulum",
    {"angle": Signal("rad"), "rate": Signal("rad/s")},
    {"torque": Signal("N m", 1.0, -0.7, 0.7)},
    equations,
    trim={"angle": 0.0, "rate": 0.0},
)
"""


@pytest.mark.slow
def test_kinks_and_tables_are_proved_on_boxes(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A loop with kinks is proved on boxes, and the set extends beyond both kinks.

    The certificate is checked without further options. The game of other weights is refused. Sums
    of squares prove a set that ends short of the first kink.
    """
    path = tmp_path / "kinked.py"
    path.write_text(KINKED)
    kinked = ["--aircraft", f"{path}:KINKED"]
    loop = pendulum_loop(load_model(kinked[1]))

    def is_beyond_kinks(region: Region) -> bool:
        return region.extents["angle"][1] > 0.5 and region.extents["rate"][1] > 0.7

    found = first_region(loop, "boxes", is_beyond_kinks)
    assert is_beyond_kinks(found)
    proof = tmp_path / "proof.json"
    origin = {"version": "", "command": "", "date": ""}
    write_certificate(proof, found.statement, found.witness, origin)
    assert main(["prove", *kinked, "--check", str(proof)]) == 0
    shown = " ".join(capsys.readouterr().out.split())
    assert "kinked pendulum, of the policy in the certificate" in shown
    assert main(["prove", "region", *kinked, "--Q", "1,9", "--R", "1", "--check", str(proof)]) == 1
    assert "K in the certificate differs from the value of the game" in capsys.readouterr().err
    assert 0.1 < first_region(loop, "squares").extents["angle"][1] < 0.4


@pytest.mark.parametrize("interrupted", [False, True])
def test_the_largest_set_is_reported(interrupted: bool, monkeypatch: pytest.MonkeyPatch) -> None:
    """Of the sets of the provers, the largest is reported, with what the others did.

    Each set that is larger than all before is saved. Each prover gets an equal part of the time
    that is left. After an interruption, no further prover is tried.
    """
    sizes = {"a": 3.0, "b": 1.0, "c": 2.0, "d": 4.0}
    left: list[float] = []

    def prover(name: str) -> Any:
        unknown: Any = None
        found = SimpleNamespace(size=sizes[name])
        region = Region(unknown, {"prover": name}, 1, cast(Any, found), {}, "", unknown)

        def prove(problem: RegionProblem, settings: Settings) -> Region:
            assert settings.save is not None
            left.append(settings.clock.left)
            settings.save(region)
            settings.clock.interrupted = interrupted
            return region

        return prove

    saved: list[str] = []
    monkeypatch.setattr(searches, "PROVERS", {name: prover(name) for name in sizes})
    monkeypatch.setattr(searches, "_with_obstacles", lambda region, seconds, clock: region)
    found = proved_region(
        cast(Any, None),
        tuple(sizes),
        degree=2,
        seconds=120.0,
        save=lambda region: saved.append(region.prover),
    )
    if interrupted:
        assert (found.prover, saved, found.others) == ("a", ["a"], {})
        return
    assert found.prover == "d"
    shares = {"a": "0.75", "b": "0.25", "c": "0.5"}
    assert found.others == {
        name: f"proves a set of {share} times the size" for name, share in shares.items()
    }
    assert saved == ["a", "d"]
    assert left == pytest.approx([30.0, 40.0, 60.0, 120.0], abs=1.0)


def test_obstacles_get_the_time_that_is_left(monkeypatch: pytest.MonkeyPatch) -> None:
    """They get at least a tenth of the limit. A known rise is kept, and others are searched."""
    times: list[float] = []

    def around(loop: Any, proved: LevelSet, rise: Any, clock: Clock) -> Any:
        times.append(clock.left)
        return rise

    monkeypatch.setattr(searches, "obstacles_around", around)
    reach: list[np.ndarray] = []

    def first(is_obstacle: Any, V: Any, T: np.ndarray) -> Any:
        reach.append(T)
        return (3.0, T)

    monkeypatch.setattr(searches, "first_obstacle", first)
    level_set = LevelSet(PolynomialFunction.quadratic(np.eye(2)), 1.0, np.diag([2.0, 3.0]))
    unknown: Any = None
    region = Region(unknown, {}, 1, level_set, {}, "", unknown)
    found = searches._with_obstacles(region, 50.0, Clock(20.0))
    assert (found.rise, found.obstacles) == ((3.0, reach[0]), found.rise)
    assert np.array_equal(reach[0], np.diag([4.0, 6.0]))
    known = searches._with_obstacles(replace(region, rise=(2.0, None)), 50.0, Clock(-1.0))
    assert known.rise == (2.0, None)
    assert times == pytest.approx([20.0, 5.0], abs=1.0)


@pytest.mark.parametrize("name", ["region", "region_boxes"])
def test_a_region_of_a_certificate_has_its_set(name: str) -> None:
    """V of the set has the values of V of the statement, and the set is in its unit ball."""
    content = stored(name)
    statement, witness = read(content)
    proved = as_proved(statement, witness, (5,))
    region = region_of_certificate(proved, content["witness"])
    assert (region.rho, region.prover) == (statement.rho, content["witness"]["prover"])
    assert region.size == 5
    reach = np.array([high for _, high in statement.extents.values()])
    z = np.random.default_rng(0).uniform(-1.5, 1.5, (200, 2)) * reach
    V = statement.piece.W.at(z @ statement.piece.M.T)
    assert region.set.V(z) == pytest.approx(V, rel=1e-9)
    inside = region.set.V(z) <= region.rho
    assert 0 < np.count_nonzero(inside) < 200
    assert np.array_equal(region.set.contains(z), inside)
    for (low, high), values in zip(region.extents.values(), z[inside].T, strict=True):
        assert low < values.min() < values.max() < high
    assert np.all(np.linalg.eigvals(region.loop.J).real < 0.0)


@pytest.mark.slow
def test_a_resumed_search_proves_a_larger_set(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A second run with --resume continues from the quadratic set and proves a larger set.

    V of the larger set is quartic. A certificate of another aircraft cannot be resumed.
    """
    proof = tmp_path / "proof.json"
    words = ["prove", "region", "--aircraft", VAN_DER_POL, "--prover", "boxes", "-o", str(proof)]
    words += ["--json"]
    assert main([*words, "--degree", "2", "--seconds", "4"]) == 0
    quadratic = json.loads(capsys.readouterr().out)
    assert (quadratic["prover"], quadratic["degree"]) == ("boxes", 2)
    assert main([*words, "--degree", "4", "--resume", "--seconds", "12"]) == 0
    quartic = json.loads(capsys.readouterr().out)
    assert quartic["degree"] == 4
    assert quartic["extents"]["velocity"] > 1.05 * quadratic["extents"]["velocity"]
    mine = ["prove", "region", "--aircraft", PENDULUM, "--prover", "boxes", "--resume"]
    assert main([*mine, "-o", str(proof)]) == 2


def test_a_refusal_names_what_was_tried(capsys: pytest.CaptureFixture[str]) -> None:
    """Without time, both provers are tried and the message names the reason of each.

    For the network of a file and for disturbances, only one prover applies.
    """
    words = ["prove", "region", "--aircraft", PENDULUM, "--seconds", "0.0001"]
    assert main(words) == 1
    error = capsys.readouterr().err
    assert "no region was proved by squares or boxes: squares: the time limit" in error
    assert "; boxes: the time limit" in error
    assert main([*words, "--disturbance", "push=0.1"]) == 1
    assert "no region was proved: the time limit" in capsys.readouterr().err
    assert main([*words, "--disturbance", "push=0.1", "--prover", "boxes"]) == 2
    assert "use --prover squares" in capsys.readouterr().err


def test_the_state_where_a_search_ended_is_named(monkeypatch: pytest.MonkeyPatch) -> None:
    """If no level is proved, the message names the state nearest to the trim with V' >= 0.

    The checker is replaced by one that accepts nothing. For x' = -x + 4 x³, V' >= 0 at x = 0.5.
    """
    states = {"x": Signal(min=-1.0, max=1.0)}
    model = Model("cubic", states, {}, lambda x, u, p, w: ({"x": -x.x + 4.0 * x.x**3}, {}), trim={})
    loop = Loop(model, {}, {"x": 0.0}, {}, {}, {"x": (-1.0, 1.0)}, Gain(np.zeros((0, 1))))
    for name in ("proved_level", "accepted"):
        monkeypatch.setattr(f"hfa_prove.search.region_squares.{name}", lambda *_: None)
    with pytest.raises(NoSolutionError, match=r"is proved; V' >= 0 at x -?0[.](5|49|50)"):
        proved_region(RegionProblem(loop), ("squares",), degree=2, seconds=20.0)
