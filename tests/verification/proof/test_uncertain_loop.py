"""Loops through actuators of intervals, and loops of other aircraft: proved, and left open beyond the true limit."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path
from typing import Any

import casadi as ca
import numpy as np
import pytest
from known_models import model_at
from proof_cases import ORIGIN, delayed_abscissa, exact_table, family, forge, through_actuators

from hfa_support import BadInputError, Model, Signal
from hfa_support.model import load_model
from trim import find_operating_point, linearize
from verification import Family, check_certificate, prove_rate, prove_schedule, solve_game
from verification.checker import checker
from verification.proof.certificate_file import ScheduleCertificate
from verification.proof.proof_report import checked_report, schedule_proof_report
from verification.proof.scheduled_loop import LoopTable
from verification.proof.uncertain_loop import common_lyapunov

NAVION = "examples/navion.py:NAVION"


@pytest.mark.parametrize("delay", [0.02, 0.5])
def test_a_delay_beyond_the_true_limit_is_left_open(delay: float) -> None:
    """By the delay equation's own eigenvalues the loop stands 0.02 s and not 0.5 s."""
    table = through_actuators(14.0, 14.125, delay=delay)
    model, drawn = model_at(14.0), np.random.default_rng(0)
    worst = max(delayed_abscissa(table, model.A, model.B, 10.0, np.ones(5), share * delay) for share in (0.5, 1.0))
    assert (worst < 0.0) == (delay < 0.1)
    proof = prove_schedule(family(), table, 14.0, 14.125)
    assert proof.proved == (worst < 0.0)
    assert proof.loop.gaps == ([] if worst < 0.0 else [(14.0, 14.125)])
    report = schedule_proof_report(proof)
    assert report.title.startswith("Proved" if worst < 0.0 else "Left open")
    assert report.data["actuators"]["delay"] == delay
    for _ in range(20 if worst < 0.0 else 0):
        late, arrives = drawn.uniform(0.0, delay), drawn.uniform(0.5, 1.0, 5)
        assert delayed_abscissa(table, model.A, model.B, drawn.uniform(1.8, 10.0), arrives, late) < 0.0


def test_a_bandwidth_beyond_the_true_limit_is_left_open() -> None:
    """Of the same gains: actuators of 0.02 rad/s leave the aircraft, which is unstable at 14 deg, to itself."""
    table = through_actuators(14.0, 14.125)
    assert table.actuators is not None
    model = model_at(14.0)
    assert delayed_abscissa(table, model.A, model.B, 0.02, np.ones(5), 0.0) > 0.0
    slower = replace(table, actuators=replace(table.actuators, bandwidth=(0.02, 10.0)))
    assert not prove_schedule(family(), slower, 14.0, 14.125).proved


def test_one_lyapunov_function_serves_its_points_and_none_is_found_for_an_unstable_one() -> None:
    """x' = -x + k (x + d) with |d| <= |x|/2, k from 0 to 0.5: V = x² decreases; with k up to 0.7 it does not."""
    for most, exists in ((0.5, True), (0.7, False)):
        points = [
            (np.array([[-1.0 + k, 0.0, k]]), np.array([[0.0, 0.0, 0.0]]), np.array([[0.5, 0.0, 0.0]]))
            for k in (0.0, most)
        ]
        found = common_lyapunov(points)
        assert (found is not None) == exists
        if found is not None:
            H, (_, x) = found
            for R, _, _ in points:
                form = -H * np.outer([1, 0, 0], R[0])
                form = form + form.T + np.diag([-x / 4, 1.0, x])
                assert np.linalg.eigvalsh(form)[0] > 0.0


@pytest.fixture(scope="module")
def navion() -> tuple[Family, LoopTable]:
    """The LQR's gains of the Navion at 160 and 176 ft/s, weights 1/nominal²."""
    flights, gains = Family(load_model(NAVION)), []
    for speed in (160.0, 176.0):
        model = linearize(flights.model, flights.point(speed))
        gains.append(solve_game(usual(flights.model, model.A, model.B)).K)
    return flights, LoopTable.of_gains(np.array([160.0, 176.0]), np.array(gains), 8)


def usual(model: Model, A: np.ndarray, B: np.ndarray) -> Any:
    from controller.game.zero_sum import usual_game

    return usual_game(model, A, B)


def test_gains_over_the_speed_of_another_aircraft(navion: tuple[Family, LoopTable], tmp_path: Path) -> None:
    flights, table = navion
    path = tmp_path / "navion.json"
    proof, motion = prove_schedule(flights, table, 160.0, 168.0), prove_rate(flights, table, 160.0, 168.0)
    assert proof.proved
    assert motion.rate > 0.0
    for each in proof.loop.proved:
        for speed in (each.box.low, each.box.high):
            model = linearize(flights.model, flights.point(speed))
            share = (speed - 160.0) / 16.0
            loop = model.A - model.B @ (table.K[0] + share * (table.K[1] - table.K[0]))
            assert np.linalg.eigvals(loop).real.max() < -each.rate
            assert np.all((each.model.A[..., 0] <= model.A) & (each.model.A[..., 1] >= model.A))
    ScheduleCertificate(flights, table, 160.0, 168.0, path, ORIGIN).finish(proof, motion)
    data = checked_report(check_certificate(path, model=flights.model)).data
    assert (data["proved"], data["one_branch"]) == (True, True)
    assert data["scheduled"] == {"speed": [160.0, 168.0]}
    with pytest.raises(BadInputError, match="name its file by --aircraft"):
        check_certificate(path)
    with pytest.raises(BadInputError, match="of another file"):
        check_certificate(path, model=replace(flights.model, source=("other.py:NAVION", "0" * 64)))


def test_a_planted_unstable_gain_of_another_aircraft_is_refuted(navion: tuple[Family, LoopTable]) -> None:
    flights, table = navion
    assert prove_schedule(flights, replace(table, K=-table.K), 160.0, 161.0).refuted


def test_a_model_with_tables_is_refused_by_the_operation() -> None:
    with pytest.raises(BadInputError, match="its equations use if_else; a proof takes smooth equations"):
        Family(load_model("examples/f16.py:F16")).check(400.0, 410.0)


@pytest.mark.parametrize(("kink", "name"), [(ca.fabs, "fabs"), (lambda x: ca.fmax(x, 0), "fmax")])
def test_a_kink_is_refused_by_name_unless_it_is_constant(kink: Any, name: str) -> None:
    """v' = u - v + kink(v) is refused, v' = u - v + kink(a) with an imposed a is not; a parameter is scheduled."""

    def flights(of: str) -> Family:
        model = Model(
            name="kinked",
            states={"v": Signal(nominal=1.0), "a": Signal(nominal=1.0)},
            inputs={"u": Signal(nominal=1.0, start=1.0)},
            parameters={"p": Signal(nominal=1.0, start=1.0)},
            equations=lambda x, u, p, w: ({"v": u.u - p.p * x.v + kink(getattr(x, of)), "a": 0 * x.a}, {}),
            trim={"v": 1.0, "a": 0.5},
            steady=("v",),
            linear=("v",),
            schedule="p",
        )
        return Family(model)

    with pytest.raises(BadInputError, match=f"kinked: its equations use {name};"):
        flights("v").check(1.0, 2.0)
    if name == "fabs":
        return
    own = flights("a")
    own.check(1.0, 2.0)
    table = LoopTable.of_gains(np.array([1.0, 2.0]), np.array([[[0.5]], [[1.0]]]), 1)
    proof = prove_schedule(own, table, 1.0, 2.0)
    assert proof.proved
    assert find_operating_point(own.model, own.condition()).inputs.u == pytest.approx(1.0 - kink(0.5))


def test_trims_of_boxes_that_are_not_one_branch_are_told(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Where the second box seeks another root than the first one finds."""
    path = tmp_path / "certificate.json"
    proof = prove_schedule(family(), exact_table(14.0, 14.125), 14.0, 14.125)
    assert proof.loop.proved
    file = ScheduleCertificate(family(), proof.table, 14.0, 14.125, path, ORIGIN)
    file.finish(proof)
    whole = check_certificate(path)
    assert whole.parted == []
    content = json.loads(path.read_text())
    box = content["boxes"]["modes"][0]
    apart, known = json.loads(json.dumps(box)), checker.model_on(content["statement"], box, whole.model)
    apart["trim"]["throttle"][0] += 3 * apart["trim"]["throttle"][3]
    roots = {"loop": [checker.Root(box, known["root"])], "modes": [checker.Root(apart, known["root"])]}
    assert checker._parted(roots) == [14.0]
    assert checker._parted(roots | {"modes": roots["loop"]}) == []
    monkeypatch.setattr(checker, "_parted", lambda _: [14.0])
    assert checked_report(check_certificate(forge(path, content))).data["proved"] is False
