"""Monte Carlo of flights: each member is the flight it claims to be, drawn as asked, the same bits everywhere."""

from __future__ import annotations

import os
import signal
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from controller.flight.closed_loop import ClosedLoop, CompiledLoop
from controller.flight.critic_policy import CriticPolicy, forcing
from controller.flight.envelope import flight_envelope
from controller.flight.plants import LinearizedAircraft, NonlinearPlant
from controller.flight.signals import Harmonic, Signal, zero
from controller.game.zero_sum import Game
from controller.laws.published_law import PublishedSettings, published_law
from controller.monte_carlo import member_draws, member_flight, stored_members as monte_carlo
from controller.monte_carlo.member_draws import Draws, draws_of
from controller.monte_carlo.member_flight import fly_member
from controller.monte_carlo.monte_carlo_plan import Course, MonteCarlo, Uncertainty, critic_law, gain_law
from controller.monte_carlo.monte_carlo_report import monte_carlo_data
from controller.monte_carlo.stored_members import MonteCarloJob, fly_members, stream_monte_carlo
from controller.monte_carlo.uncertain_plants import UncertainLinearization
from hfa_model.aircraft import Aircraft
from hfa_model.dynamics import rates
from hfa_model.native import machine_code as generated
from hfa_model.parameters import Parameters, default_parameters
from hfa_model.support.errors import BadInputError
from hfa_model.support.store import Store, open_store
from hfa_model.variants import variant_named
from hfa_model.vectors import LINEAR_STATES, STATES, Input, State
from trim.point.operating_point import OperatingPoint

PARAMETERS = default_parameters().values
SEEN = [STATES.index(name) for name in LINEAR_STATES]
EVERYTHING = Uncertainty(
    errors={"panel_mass": 0.05, "lift_slope": 0.03, "hinge_stiffness": 0.1},
    noise={"alpha": 0.002, "pitch_rate": 0.004},
    turbulence=(3.0, 1750.0),
)


@pytest.fixture
def plan(point: OperatingPoint, gain: np.ndarray) -> MonteCarlo:
    """Twelve short flights of everything."""
    wave = Harmonic(3.0, np.full(6, 1e-3), np.zeros(6))
    envelope = flight_envelope(PARAMETERS, point)
    course = Course(
        lowest=np.array(envelope.lowest),
        highest=np.array(envelope.highest),
        duration=0.5,
        initial=0.1 * np.array([0.2, 0.01, 5.0, 0.01, 0.02, 0.03, 0.02]),
        reference=Signal(np.array([0.1, 0, 0, 0, 0.01, 0]), np.zeros(6)),
        disturbance=Signal(np.zeros(6), np.zeros(6), (wave,)),
    )
    return MonteCarlo(12, 7, PARAMETERS, "published", point, "nonlinear", gain_law("exact", gain), course, EVERYTHING)


def with_course(plan: MonteCarlo, **changes: object) -> MonteCarlo:
    return replace(plan, course=replace(plan.course, **changes))


# A member is the flight that it claims to be.


Rate = Callable[[np.ndarray, np.ndarray, np.ndarray, float], np.ndarray]


def nonlinear_rate(plan: MonteCarlo, draws: Draws) -> Rate:
    """x' by the equations of motion in plain numbers, without any compiled function."""
    X0, U0 = np.array(plan.point.states), np.array(plan.point.inputs)
    p, variant = Parameters(*draws.parameters.tolist()), variant_named(plan.dynamics)

    def rate(x: np.ndarray, u: np.ndarray, d: np.ndarray, w: float) -> np.ndarray:
        value = np.array([float(row) for row in rates(State(*(X0 + x)), Input(*(U0 + u)), p, variant, w)])
        value[SEEN] += d
        return value

    return rate


def linear_rate(plan: MonteCarlo, draws: Draws) -> Rate:
    """f0 + A x + B u + b w + d of the aircraft that is flown, about the trim of the nominal one."""
    wrong = Aircraft(Parameters(*draws.parameters.tolist()), plan.dynamics)
    model = LinearizedAircraft.at(wrong, plan.point)
    offset = wrong.rates(np.array(plan.point.states), np.array(plan.point.inputs))

    def rate(x: np.ndarray, u: np.ndarray, d: np.ndarray, w: float) -> np.ndarray:
        value = offset + model.A @ x + model.B @ u + model.gust * w
        value[SEEN] += d
        return value

    return rate


def flown_plainly(plan: MonteCarlo, draws: Draws, rate_of: Callable[[MonteCarlo, Draws], Rate]) -> Mapping[str, object]:
    """The summary of a member under u = -K z, by a Runge-Kutta loop in NumPy on the history of every step."""
    course, h = plan.course, plan.course.step
    K, rate, air = plan.law.constants.reshape(5, 6, order="F"), rate_of(plan, draws), draws.air
    x, filter_ = plan.course.initial.copy(), np.zeros(0) if air is None else air.start()
    errors, inputs, left, flown = [], [], -1, course.duration

    def slope(t: float, x: np.ndarray, f: np.ndarray, tick: int) -> tuple[np.ndarray, np.ndarray]:
        z = x[SEEN] - course.reference.at(t)
        u = -K @ (z + draws.noise[tick])
        w, filter_rate = 0.0, np.zeros(0)
        if air is not None:
            held = air.constants(tick)
            w = float(air.updraft(t, f, held))
            filter_rate = np.array(air.memory_rate(t, f, held)).ravel()
        return rate(x, u, course.disturbance.at(t), w), filter_rate

    for step in range(course.ticks * course.steps_per_tick):
        t, tick = step * h, step // course.steps_per_tick
        z = x[SEEN] - course.reference.at(t)
        errors.append(z)
        inputs.append(-K @ (z + draws.noise[tick]))
        k1 = slope(t, x, filter_, tick)
        k2 = slope(t + h / 2, x + h / 2 * k1[0], filter_ + h / 2 * k1[1], tick)
        k3 = slope(t + h / 2, x + h / 2 * k2[0], filter_ + h / 2 * k2[1], tick)
        k4 = slope(t + h, x + h * k3[0], filter_ + h * k3[1], tick)
        x = x + h / 6 * (k1[0] + 2 * k2[0] + 2 * k3[0] + k4[0])
        filter_ = filter_ + h / 6 * (k1[1] + 2 * k2[1] + 2 * k3[1] + k4[1])
        X = x + np.array(plan.point.states)
        outside = np.maximum(X - course.highest, course.lowest - X) / (course.highest - course.lowest)
        if outside.max() > 0.0:
            left, flown = int(np.argmax(outside)), t + h
            break
    return {
        "left": left,
        "flown": flown,
        "rms_error": np.sqrt(np.mean(np.square(errors), axis=0)),
        "peak_error": np.max(np.abs(errors), axis=0),
        "effort": np.sqrt(np.mean(np.square(inputs), axis=0)),
        "final": x + np.array(plan.point.states),
    }


def assert_same_flight(plan: MonteCarlo, member: int, rate_of: Callable[[MonteCarlo, Draws], Rate]) -> None:
    draws, summary = fly_member(plan, member)
    for name, value in flown_plainly(plan, draws, rate_of).items():
        np.testing.assert_allclose(getattr(summary, name), value, rtol=1e-8, atol=1e-12, err_msg=name)


@pytest.mark.parametrize("dynamics", ["published", "newton"])
@pytest.mark.parametrize(("plant", "rate_of"), [("nonlinear", nonlinear_rate), ("linear", linear_rate)])
def test_a_member_is_its_flight_step_by_step(plan: MonteCarlo, dynamics: str, plant: str, rate_of) -> None:
    assert_same_flight(with_course(replace(plan, dynamics=dynamics, plant=plant), duration=0.05), 3, rate_of)


@pytest.mark.skipif(generated._compiler() is None, reason="no C compiler on this machine")
def test_machine_code_flies_the_same(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path))
    long = replace(plan, members=1000)
    assert_same_flight(with_course(long, duration=0.5, tick=0.1, step=0.005), 3, nonlinear_rate)
    assert len(list(tmp_path.rglob("*.so"))) == 1


def test_a_member_that_leaves_its_envelope_ends_there(plan: MonteCarlo) -> None:
    away = replace(plan, law=gain_law("wrong sign", -np.array(plan.law.identity["K"])), plant="linear")
    draws, summary = fly_member(away, 0)
    assert 0.0 < summary.flown < away.course.duration
    assert STATES[summary.left] in ("pitch_rate", "alpha")
    assert_same_flight(away, 0, linear_rate)
    assert draws.noise.shape == (50, 6)


def test_the_flight_test_sees_a_wrong_parameter(plan: MonteCarlo) -> None:
    def forgetful(plan: MonteCarlo, draws: Draws) -> Rate:
        return nonlinear_rate(plan, draws._replace(parameters=np.array(plan.parameters)))

    with pytest.raises(AssertionError, match=r"rms_error|peak_error|effort"):
        assert_same_flight(with_course(plan, duration=0.05), 3, forgetful)


def test_the_linear_plant_is_the_derivative_at_the_trim_of_the_design(point: OperatingPoint) -> None:
    wrong = PARAMETERS._replace(panel_mass=1.1 * PARAMETERS.panel_mass)
    plant = UncertainLinearization(variant_named("published"), point)
    for parameters in (PARAMETERS, wrong):
        matrix = plant.constants(np.array(parameters)).reshape(7, 14, order="F")
        model = LinearizedAircraft.at(Aircraft(parameters), point)
        whole = np.hstack([model.A, model.B, model.gust[:, None]])
        np.testing.assert_allclose(matrix[:, 1:], whole, rtol=1e-12, atol=1e-13)
        offset = Aircraft(parameters).rates(np.array(point.states), np.array(point.inputs))
        np.testing.assert_allclose(matrix[:, 0], offset, rtol=1e-9, atol=1e-12)


@pytest.fixture(scope="module")
def critic(game: Game) -> CriticPolicy:
    settings = PublishedSettings(
        samples=30, basis="quadratic", coordinates="scaled", gains=(10.0, 10.0), initial_weights=1.0
    )
    return CriticPolicy(published_law(game, settings, seed=0), forcing(game.A, zero(6)))


def test_the_published_critic_learns_in_each_member(plan: MonteCarlo, critic: CriticPolicy) -> None:
    learning = with_course(replace(plan, law=critic_law("published", critic), uncertainty=Uncertainty()), duration=0.05)
    _, summary = fly_member(learning, 0)
    loop = ClosedLoop(
        NonlinearPlant(Aircraft(PARAMETERS), plan.point),
        critic,
        plan.course.reference,
        plan.course.disturbance,
        zero(6),
    )
    start = critic.law.start()["weights"]
    flight = CompiledLoop(loop).fly(
        plan.course.initial, lambda tick: np.ones(1), step=0.001, steps_per_tick=10, ticks=5, memory=start
    )
    np.testing.assert_allclose(summary.memory, flight.memory[-1], rtol=1e-10)
    np.testing.assert_allclose(summary.final, flight.states[-1] + np.array(plan.point.states), rtol=1e-12)
    assert np.abs(summary.memory - start).max() > 1e-6


def test_all_members_fly_one_compiled_function(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch) -> None:
    made = []
    monkeypatch.setattr(member_flight, "COMPILE_FROM_STEPS", 1)
    monkeypatch.setattr(member_flight, "machine_code", lambda function: made.append(function) or function)
    result = fly_members(replace(plan, seed=99), 0, 4)  # no other test has this plan's loop made
    assert len(made) == 1
    assert len(np.unique(result["final"][:, 0])) == 4


# What is drawn.


def drawn(plan: MonteCarlo, members: int) -> np.ndarray:
    return np.array([draws_of(plan, member).factors for member in range(members)])


def complaints_about_draws(plan: MonteCarlo, members: int = 2000) -> list[str]:
    """What is wrong with the drawn errors: members alike, or not the log-normal law with mean 1 that was asked for."""
    from scipy.stats import kstest

    factors = drawn(plan, members)
    found = [] if len(np.unique(factors, axis=0)) == members else ["members are alike"]
    sigmas = np.sqrt(np.log1p(np.square(list(plan.uncertainty.errors.values()))))
    for name, column, sigma in zip(plan.uncertainty.errors, factors.T, sigmas, strict=True):
        # One in a thousand of right laws would fail; the seed is fixed, so that none does later.
        if kstest((np.log(column) + sigma**2 / 2) / sigma, "norm").pvalue < 1e-3:
            found.append(f"{name} does not have its law")
    correlation = np.corrcoef(factors.T) - np.eye(len(sigmas))
    return found + ["errors are correlated"] * bool(np.abs(correlation).max() > 4.0 / np.sqrt(members))


def test_errors_have_the_law_that_was_asked_for(plan: MonteCarlo) -> None:
    assert complaints_about_draws(plan) == []
    factors = drawn(plan, 2000)
    asked = np.array(list(plan.uncertainty.errors.values()))
    assert np.all(np.abs(factors.mean(axis=0) - 1.0) < 4 * asked / np.sqrt(2000))
    assert np.all(np.abs(factors.std(axis=0) / asked - 1.0) < 4 / np.sqrt(2 * 2000))
    draws = draws_of(plan, 5)
    nominal = np.array(PARAMETERS, dtype=float)
    changed = [Parameters._fields[i] for i in np.flatnonzero(draws.parameters != nominal)]
    assert set(changed) == set(plan.uncertainty.errors)
    index = Parameters._fields.index("lift_slope")
    assert draws.parameters[index] == nominal[index] * draws.factors[1]


@pytest.mark.parametrize(
    ("sequence", "complaint"),
    [
        (lambda seed, member, kind: np.random.SeedSequence(seed, spawn_key=(kind,)), "members are alike"),
        (lambda seed, member, kind: np.random.SeedSequence(member // 2, spawn_key=(kind,)), "members are alike"),
    ],
    ids=["one seed for all", "two members share one"],
)
def test_a_seed_that_ignores_the_member_is_noticed(plan: MonteCarlo, monkeypatch, sequence, complaint: str) -> None:
    monkeypatch.setattr(member_draws, "_sequence", sequence)
    assert complaint in complaints_about_draws(plan, 300)


def test_a_wrong_deviation_is_noticed(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch) -> None:
    honest = member_draws.draws_of
    monkeypatch.setitem(
        globals(), "draws_of", lambda plan, member: (d := honest(plan, member))._replace(factors=d.factors**1.2)
    )
    assert len(complaints_about_draws(plan)) == len(plan.uncertainty.errors)


def test_seed_and_member_decide_everything(plan: MonteCarlo) -> None:
    one, again, next_one = draws_of(plan, 3), draws_of(replace(plan, members=99), 3), draws_of(plan, 4)
    other_seed = draws_of(replace(plan, seed=8), 3)
    for name in ("factors", "parameters", "noise"):
        assert np.array_equal(getattr(one, name), getattr(again, name))
        assert not np.array_equal(getattr(one, name), getattr(next_one, name))
        assert not np.array_equal(getattr(one, name), getattr(other_seed, name))
    assert one.air == again.air
    assert len({one.air.seed, next_one.air.seed, other_seed.air.seed}) == 3
    # One kind of randomness less leaves the others alone.
    calm = draws_of(replace(plan, uncertainty=replace(EVERYTHING, noise={}, turbulence=None)), 3)
    assert np.array_equal(calm.factors, one.factors)
    assert not calm.noise.any()
    assert calm.air is None


def test_noise_and_air_are_as_strong_as_asked_for(plan: MonteCarlo) -> None:
    draws = [draws_of(plan, member) for member in range(200)]
    noise = np.stack([each.noise for each in draws])
    deviation = noise.std(axis=(0, 1))
    assert deviation[LINEAR_STATES.index("alpha")] == pytest.approx(0.002, rel=0.03)
    assert deviation[LINEAR_STATES.index("pitch_rate")] == pytest.approx(0.004, rel=0.03)
    assert np.count_nonzero(deviation) == 2
    assert abs(np.corrcoef(noise[0, :, 1], noise[1, :, 1])[0, 1]) < 0.5
    updrafts = [float(each.air.updraft(0.0, each.air.start(), np.zeros(1))) for each in draws]
    assert np.std(updrafts) == pytest.approx(3.0, rel=0.15)
    assert draws[0].air.speed == plan.point.states.speed


# The same bits everywhere.


def assert_same(first: Mapping[str, np.ndarray] | Store, second: Mapping[str, np.ndarray] | Store) -> None:
    for name in ("factors", "left", "flown", "rms_error", "peak_error", "effort", "final", "memory"):
        one, other = (each.read(name) if isinstance(each, Store) else each[name] for each in (first, second))
        assert np.array_equal(one, other), name


@pytest.fixture
def small_chunks(plan: MonteCarlo, monkeypatch: pytest.MonkeyPatch) -> None:
    """Two members a chunk, six chunks."""
    monkeypatch.setattr(monte_carlo, "CHUNK_STEPS", 2 * plan.course.ticks * plan.course.steps_per_tick)


def test_chunks_and_their_order_do_not_matter(plan: MonteCarlo) -> None:
    whole = fly_members(plan, 0, 6)
    last, first = fly_members(plan, 4, 6), fly_members(plan, 0, 4)
    assert_same(whole, {name: np.concatenate([first[name], last[name]]) for name in whole})
    assert MonteCarloJob(plan).layout.chunk * plan.course.duration / plan.course.step >= monte_carlo.CHUNK_STEPS


def fly_or_die(plan: MonteCarlo, start: int, stop: int) -> Mapping[str, np.ndarray]:
    """`fly_members`, but the first process that comes to member 4 kills itself."""
    flag = Path(os.environ["DIED"])
    if start == 4 and not flag.exists():
        flag.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return fly_members(plan, start, stop)


@pytest.fixture
def deadly(small_chunks: None, monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> Path:
    """Workers started from now on run `fly_or_die`; the file exists once one has died."""
    monkeypatch.setenv("DIED", str(tmp_path / "died"))
    monkeypatch.setattr(monte_carlo, "fly_members", fly_or_die)
    return tmp_path / "died"


def test_two_processes_give_the_bits_of_one_and_a_killed_one_loses_nothing(
    plan: MonteCarlo, deadly: Path, tmp_path: Path
) -> None:
    two = stream_monte_carlo(plan, tmp_path / "two.zarr", count=2)
    assert deadly.exists()
    assert two.missing() == []
    assert_same(two, fly_members(plan, 0, 12))


def test_a_dask_cluster_gives_the_same_bits_and_a_killed_worker_loses_nothing(
    plan: MonteCarlo, deadly: Path, tmp_path: Path
) -> None:
    distributed = pytest.importorskip("distributed")
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=":0") as cluster:
        assert len({worker.pid for worker in cluster.workers.values()} - {os.getpid()}) == 2
        spread = stream_monte_carlo(plan, tmp_path / "spread.zarr", scheduler=cluster.scheduler_address)
    assert deadly.exists()
    assert spread.missing() == []
    assert_same(spread, fly_members(plan, 0, 12))


def test_a_resumed_run_flies_only_what_is_missing(
    plan: MonteCarlo, small_chunks: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    class Stop(Exception):
        pass

    def stop_after_two(done: int, total: int) -> None:
        if done == 2:
            raise Stop

    with pytest.raises(Stop):
        stream_monte_carlo(plan, tmp_path / "part.zarr", progress=stop_after_two)
    assert len(open_store(tmp_path / "part.zarr").missing()) == 4
    flown = []
    monkeypatch.setattr(monte_carlo, "fly_members", lambda *task: flown.append(task[1:]) or fly_members(*task))
    resumed = stream_monte_carlo(plan, tmp_path / "part.zarr", resume=True)
    assert flown == [(4, 6), (6, 8), (8, 10), (10, 12)]
    assert_same(resumed, fly_members(plan, 0, 12))
    with pytest.raises(BadInputError, match="another Monte Carlo"):
        stream_monte_carlo(replace(plan, seed=8), tmp_path / "part.zarr", resume=True)
    with pytest.raises(BadInputError, match="exists"):
        stream_monte_carlo(plan, tmp_path / "part.zarr")


def test_plans_are_equal_when_they_give_the_same_results(plan: MonteCarlo, gain: np.ndarray, critic) -> None:
    assert replace(plan) == plan
    assert hash(replace(plan)) == hash(plan)
    others = [
        replace(plan, seed=8),
        replace(plan, plant="linear"),
        replace(plan, law=gain_law("exact", 1.01 * gain)),
        replace(plan, law=critic_law("published", critic)),
        replace(plan, uncertainty=replace(EVERYTHING, turbulence=None)),
        with_course(plan, step=0.0005),
        with_course(plan, reference=zero(6)),
    ]
    assert len({plan, *others}) == 1 + len(others)


def test_an_error_of_nothing_is_refused(plan: MonteCarlo, gain: np.ndarray) -> None:
    no_moment = PARAMETERS._replace(zero_lift_moment=0.0)
    with pytest.raises(BadInputError, match="does nothing"):
        replace(plan, parameters=no_moment, uncertainty=Uncertainty({"zero_lift_moment": 1.0}))
    with pytest.raises(BadInputError, match="5 x 6"):
        gain_law("wide", np.zeros((6, 5)))


def test_a_summary_without_members_that_held_says_so(plan: MonteCarlo, tmp_path: Path) -> None:
    lost = replace(plan, members=1, law=gain_law("wrong sign", -np.array(plan.law.identity["K"])))
    data = monte_carlo_data(lost, stream_monte_carlo(lost, tmp_path / "a.zarr"))
    assert data["held"] == 0
    assert set(data["effort"].values()) == {None}
    assert data["errors"]["panel_mass"]["deviation"] is None
    assert data["first_left"] < 0.5
