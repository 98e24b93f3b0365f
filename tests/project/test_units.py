"""No public function depends on units: each answer about an aircraft is that about its twins, the
same aircraft in other units.

`ANSWERS` has for each public function of trim, controller, verification and hfa one that asks it
about a twin: twin -> name -> answer in SI units. `WITHOUT` has the other public functions by the
reason.
"""

import functools
import inspect
import math
from itertools import chain

import casadi as ca
import numpy as np
import pytest
from twins import SI, STATES, named, scaled

import controller
import hfa
import trim
import verification

#: Name -> function that returns a twin, given whether its unit of time is the second.
TWINS = {
    f"{kind.__name__} {seed}": functools.partial(kind, seed)
    for kind in (named, scaled)
    for seed in range(3)
}
Q, R, E, DELTA = np.diag([0.01, 9.0, 4.0, 1.0]), np.diag([20.0, 1e-6]), np.eye(4)[:, [1, 3]], 40.0


# Trim, linear model, weights and game of a twin.


def point_of(twin):
    """Return the default trim of a twin."""
    return hfa.trim(twin.model)


def linear_of(twin, disturbances=()):
    """Return the linear model of a twin at its default trim."""
    return hfa.linearize(twin.model, point_of(twin), disturbances=disturbances)


def weights_of(twin):
    """Return Q and R of the cost per unit of time."""
    size = twin.second / twin.cost
    return Q * np.outer(twin.z, twin.z) * size, R * np.outer(twin.u, twin.u) * size


def game_of(twin, delta=DELTA):
    """Return the game of a twin with the weights, disturbance and delta of the game in SI units."""
    matrices = weights_of(twin)
    size = twin.disturbance * math.sqrt(twin.second / twin.cost)
    into = E * twin.second / twin.z[:, None] * twin.disturbance
    return hfa.game(
        linear_of(twin), Q=matrices[0], R=matrices[1], E=into, delta=DELTA and delta * size
    )


def gain_of(twin, K):
    """Return a gain K of a twin in SI units."""
    return K * twin.u[:, None] / twin.z


def given_gain(twin):
    """Return a gain that is 1 % off the exact one."""
    return 1.01 * hfa.solve(game_of(twin)).K


def started(twin):
    """Return a deviation of .05 rad in alpha and 2 m/s in speed, in the units of a twin."""
    return twin.typed(alpha=0.05, speed=2.0)


def moved(twin):
    """Return the states of a twin at its trim, but alpha and pitch rate .05 rad and .1 rad/s off
    it.
    """
    x = np.array(point_of(twin).x)
    x[[1, 3]] += [0.05, 0.1] / twin.of("alpha", "pitch_rate")
    return x


def nominal(twin, flight):
    """Return the states at the end of a flight of a twin, divided by the nominal values, which are
    in SI units.
    """
    sizes = twin.of(*twin.model.states)
    nominals = [signal.nominal for signal in SI.model.states.values()]
    return flight.states[-1] * sizes / nominals


def critic_answers(twin, critic):
    """Return what the verdict on a critic of a twin says, which has no units."""
    verdict = hfa.verify(game_of(twin), critic)
    return {
        "grade": verdict.grade,
        "reason": verdict.reason,
        "first line": str(verdict.report()).partition("\n")[0],
        "errors": [each.value for each in verdict.checks if each.name.endswith("error")],
    }


# Answers in SI units.


def of_trim(twin):
    answers = {}
    for name, hold, free in (
        ("level", {}, ()),
        ("climb", twin.typed(gamma=0.05, speed=50.0), ("altitude_dot",)),
        ("at a thrust", twin.typed(thrust=1000.0), ("altitude_dot",)),
        ("altitude kept", {}, ("altitude",)),
        ("an equation too many", twin.typed(gamma=0.0, speed=45.0), ()),
        ("one of many", {}, ("speed",)),
        ("one of many in climb", twin.typed(gamma=0.05), ("speed", "altitude_dot")),
    ):
        point = hfa.trim(twin.model, hold=hold, free=free)
        names = (*twin.model.states, *twin.model.inputs)
        nominals = [SI.model.signals[each].nominal for each in names]
        answers[name] = [point[each] for each in names] * twin.of(*names) / nominals
    return answers


def of_linear(twin):
    linear = linear_of(twin, ("updraft",))
    rates, updraft = twin.z[:, None] / twin.second, twin.sizes["updraft"]
    return {
        "A": linear.A * rates / twin.z,
        "B": linear.B * rates / twin.u,
        "E": linear.E * rates / updraft,
        "poles": np.sort_complex(linear.eigenvalues) / twin.second,
        "damping": [mode.damping for mode in linear.modes],
        "modes": ",".join(mode.name for mode in linear.modes),
    }


def of_modes(twin):
    modes = trim.modes_of(linear_of(twin).A, STATES, SI.model.modes)
    return {
        "names": ",".join(mode.name for mode in modes),
        "eigenvalues": np.array([mode.eigenvalue for mode in modes]) / twin.second,
        "participation": [[*mode.participation.values()] for mode in modes],
    }


def of_sweep(twin):
    found = hfa.sweep(twin.model, speed=np.array([40.0, 50.0, 60.0]) / twin.sizes["speed"])
    rates = twin.z[:, None] / twin.second
    return {"A": found.A * rates / twin.z, "eigenvalues": found.eigenvalues / twin.second}


def of_points(twin):
    speeds = np.array([[40.0], [60.0]]) / twin.sizes["speed"]
    found = trim.trim_points(twin.model, ("speed",), speeds)
    return {"inputs": found.inputs * twin.u}


def of_condition(twin):
    condition = trim.release(
        trim.usual_condition(twin.model),
        hold=twin.typed(speed=45.0),
        limits={"thrust": tuple(np.array([0.0, 2000.0]) / twin.sizes["thrust"])},
    )
    point = hfa.trim(twin.model, condition)
    return {"inputs": [point["elevator"], point["thrust"]] * twin.u}


def of_solution(twin, solution=None):
    solution = solution or hfa.solve(game_of(twin))
    size = twin.disturbance * math.sqrt(twin.second / twin.cost)
    return {
        "P": solution.P * twin.cost / np.outer(twin.z, twin.z),
        "K": gain_of(twin, solution.K),
        "poles": np.sort_complex(solution.poles()) / twin.second,
        "gains": np.array([solution.delta_min, solution.l2_gain]) / size,
        "crossover": [each.crossover / twin.second for each in solution.loops],
    }


def of_lqr(twin):
    linear, (weight, of_inputs) = linear_of(twin), weights_of(twin)
    solution = hfa.lqr(linear.A, linear.B, weight, of_inputs)
    return {"K": gain_of(twin, solution.K)}


def of_margins(twin):
    loops = hfa.margins(linear_of(twin), given_gain(twin))
    return {
        name: [loop.phase, loop.disk, loop.crossover / twin.second, loop.delay * twin.second]
        for name, loop in loops.items()
    }


def of_smallest_delta(twin):
    found = controller.minimum_delta(game_of(twin)).value
    return {"delta_min": found / twin.disturbance / math.sqrt(twin.second / twin.cost)}


def of_learning(twin):
    game = game_of(twin)
    of_states, of_inputs, noise = np.split(
        np.random.default_rng(0).normal(size=(60, 10)), [4, 6], 1
    )
    x, u = of_states / twin.z, of_inputs * [1.0, 1e4] / twin.u
    rates = x @ game.A.T + u @ game.B.T + 0.01 * noise * twin.second / twin.z
    recorded = hfa.learn(game, data={"x": x, "u": u, "x_rate": rates})
    return {
        "K": gain_of(twin, hfa.learn(game).K),
        "K of data": gain_of(twin, recorded.K),
        "band of K": gain_of(twin, recorded.K_band),
        "misfit": recorded.data.misfit,
    }


def of_value(twin):
    return critic_answers(twin, hfa.from_value(game_of(twin), 1.01 * hfa.solve(game_of(twin)).P))


def of_weights(twin):
    P = hfa.solve(game_of(twin)).P
    weights = [1.01 * P[i, j] * (1.0 if i == j else 2.0) for i in range(4) for j in range(i, 4)]
    return critic_answers(twin, hfa.from_weights(game_of(twin), weights))


def of_gain(twin):
    """Return the verdict on a gain that is 1 % off, and the reasons for one column of another."""
    game, K = game_of(twin), hfa.solve(game_of(twin)).K
    answers = critic_answers(twin, hfa.from_gain(game, given_gain(twin)))
    for name, factor in (("degrees", math.pi / 180.0), ("sign", -1.0)):
        wrong = hfa.from_gain(game, K * [1.0, factor, 1.0, 1.0])
        answers[name] = hfa.verify(game, wrong).reason
    return answers


def of_network(twin):
    """Return the verdict on two layers of relu: the exact gain, and one half of it on one side."""
    K = hfa.solve(game_of(twin)).K
    answers = {}
    for name, side in (("smooth", 1.0), ("nonsmooth", 0.5)):
        layers = {
            "0.weight": np.vstack([np.eye(4), -np.eye(4)]),
            "2.weight": np.hstack([-K, side * K]),
        }
        critic = hfa.from_network(game_of(twin), layers, activation="relu")
        answers[f"K, {name}"] = gain_of(twin, critic.K)
        answers[f"is nonsmooth, {name}"] = str(critic.is_nonsmooth)
    return answers | {"grade": hfa.verify(game_of(twin), critic).grade}


def of_expansion(twin):
    linear, game = linear_of(twin), game_of(twin, math.inf)
    expansion = hfa.expand(linear, hfa.solve(game), 4)
    z = np.array([3.0, 0.05, -0.04, 0.1]) / twin.z
    return {
        "V": float(expansion.V(z)) * twin.cost,
        "u": np.array(expansion.policy(z)).ravel() * twin.u,
    }


def of_radii(twin):
    expansion = hfa.expand(linear_of(twin), hfa.solve(game_of(twin, math.inf)), 3)
    return {"c": [radius.c * twin.cost for radius in controller.radii_of(expansion)]}


def of_tracking(twin):
    solution = hfa.solve(game_of(twin))
    found = hfa.track(
        linear_of(twin),
        solution,
        twin.typed(speed=3.0),
        duration=20.0 / twin.second,
    )
    return {"cost": found.cost_per_second * twin.cost / twin.second}


def of_filter(twin):
    """Return a filter without a sensor of alpha, in turbulence where the speed has a unit."""
    noise = twin.typed(speed=0.3, pitch=0.003, pitch_rate=0.01)
    airs = {"still": None, "turbulent": hfa.Turbulence((2.0 / twin.length, 200.0 / twin.length))}
    if twin.model.unit("speed") == "1":
        del airs["turbulent"]
    answers = {}
    for name, air in airs.items():
        found = hfa.filter(linear_of(twin, ("updraft",)), noise, air, 0.02)
        answers[f"P, {name}"] = found.P[:4, :4] * np.outer(twin.z, twin.z)
        answers[f"L, {name}"] = (
            found.L[:4] * twin.z[:, None] / twin.of("speed", "pitch", "pitch_rate")
        )
        answers[f"radius, {name}"] = found.radius
    return answers


def of_servos(twin):
    servo = hfa.Servo(0.05, twin.typed(elevator=0.2)["elevator"])
    model = hfa.with_servos(twin.model, {"elevator": servo})
    point = hfa.trim(model)
    linear, z = point.linearize(), np.append(twin.z, twin.of("elevator"))
    far = {**point.inputs._asdict()}
    far["elevator"] += twin.typed(elevator=0.1)["elevator"]
    rates = model.at(point.states, type(point.inputs)(**far)).f
    return {
        "A": linear.A * z[:, None] / z,
        "B": linear.B * z[:, None] / twin.u,
        "limited rate": rates[-1:] * twin.of("elevator"),
    }


def flown(twin, policy=None):
    tick = 0.01 / twin.second
    return hfa.fly(
        twin.model,
        point_of(twin),
        policy,
        initial=started(twin),
        predict=False,
        scenario=hfa.Scenario(200 * tick, tick / 10.0, tick),
    )


def of_flight(twin):
    return {"end": nominal(twin, flown(twin, given_gain(twin)))}


def commanded(twin, policy):
    """Return the command of a policy at the states `moved`, in SI units."""
    return {"U": policy(0.0, moved(twin)) * twin.u}


def state_dependent(twin):
    return hfa.state_dependent(twin.model, point_of(twin), *weights_of(twin), dt=0.02 / twin.second)


def of_state_dependent(twin):
    return commanded(twin, state_dependent(twin))


def of_inside(twin):
    """Return the end of a flight whose pitch rate is kept within .3 rad/s."""
    limits = {"pitch_rate": tuple(np.array([-0.3, 0.3]) / twin.sizes["pitch_rate"])}
    kept = hfa.keep_inside(state_dependent(twin), twin.model, point_of(twin), limits=limits)
    return {"end": nominal(twin, flown(twin, kept))}


def of_predictive(twin):
    policy = hfa.predictive(twin.model, point_of(twin), *weights_of(twin))
    return commanded(twin, policy)


def of_best_flight(twin):
    found = hfa.optimize(twin.model, point_of(twin), started(twin), *weights_of(twin))
    return {"cost": found.cost * twin.cost}


def linear_policy(K):
    o = ca.SX.sym("o", K.shape[1])
    return ca.Function("policy", [o], [ca.DM(K) @ o])


def deployment(twin):
    maps = {
        name: {"box": [-limit, limit], "map": "trim + a"}
        for name, limit in twin.typed(elevator=0.3, thrust=500.0).items()
    }
    return hfa.Deployment(
        policy={"file": linear_policy(-given_gain(twin))},
        observation={name: {} for name in STATES},
        action=maps,
        timing={"dt": 0.02},
        cost={
            letter: dict(zip(names, np.diag(weight).tolist(), strict=True))
            for letter, names, weight in zip("QR", (STATES, maps), weights_of(twin), strict=True)
        },
    )


def of_plant(twin):
    plant = verification.nonlinear_plant(linear_of(twin))
    z = np.array([3.0, 0.05, -0.04, 0.1]) / twin.z
    rates = np.array(plant.rates(z, np.zeros(2))).ravel()
    return {"rates": rates * twin.z / twin.second}


def of_assessment(twin):
    found = hfa.assess(
        twin.model, deployment(twin), [55.0 / twin.sizes["speed"]], samples=2, box=started(twin)
    )
    (row,) = found.points
    return {
        "holds": str(found.holds),
        "margin": row.margins.disk,
        "costs": [row.costs.median, row.costs.low, row.costs.high],
    }


def of_environment(twin):
    made = hfa.environment(twin.model, deployment(twin), seconds=1.0)
    made.reset(options={"state": moved(twin)})
    observed, reward, *_ = made.step(np.zeros(2))
    return {"observed": observed * twin.z, "reward": reward * twin.cost}


def of_record(twin):
    """Return the estimates of two parameters from a record of a flight."""
    step = {"elevator": [(0.5 / twin.second, 0.02 / twin.sizes["elevator"])]}
    flight = flown(twin, step)
    record = {"time": flight.time[::20]}
    noise = np.random.default_rng(0).standard_normal((len(flight.states[::20]), 5)) * 1e-3
    of_states = flight.states[::20] + noise / twin.of(*twin.model.states)
    record |= dict(zip(twin.model.states, of_states.T, strict=True))
    record |= dict(zip(twin.model.inputs, flight.inputs[::20].T, strict=True))
    model = twin.model.with_parameters(**twin.typed(mass=1200.0))
    found = hfa.identify(model, record, ["mass"], inputs="steps")
    estimate = found.parameters["mass"]
    return {"mass": np.array([estimate.value, estimate.high]) * twin.sizes["mass"]}


def of_sheet(twin):
    """Return the figures and levels of the sheet that have no unit."""
    rows = [row for row in trim.sheet_of(point_of(twin)) if not isinstance(row.value, str)]
    return {row.name: row.value for row in rows if not row.unit} | {
        f"level of {row.name}": str(row.level) for row in rows if row.level
    }


#: Public function -> what it says of a twin, in SI units.
ANSWERS = {
    "hfa.trim": of_trim,
    "hfa.linearize": of_linear,
    "hfa.sweep": of_sweep,
    "hfa.game": of_solution,
    "hfa.solve": of_solution,
    "hfa.lqr": of_lqr,
    "hfa.margins": of_margins,
    "hfa.learn": of_learning,
    "hfa.verify": of_gain,
    "hfa.from_gain": of_gain,
    "hfa.from_value": of_value,
    "hfa.from_weights": of_weights,
    "hfa.from_network": of_network,
    "hfa.expand": of_expansion,
    "hfa.track": of_tracking,
    "hfa.filter": of_filter,
    "hfa.fly": of_flight,
    "hfa.state_dependent": of_state_dependent,
    "hfa.keep_inside": of_inside,
    "hfa.predictive": of_predictive,
    "hfa.optimize": of_best_flight,
    "trim.modes_of": of_modes,
    "trim.trim_points": of_points,
    "trim.release": of_condition,
    "trim.usual_condition": of_condition,
    "controller.minimum_delta": of_smallest_delta,
    "controller.radii_of": of_radii,
    "verification.nonlinear_plant": of_plant,
    "hfa.assess": of_assessment,
    "hfa.environment": of_environment,
    "hfa.identify": of_record,
    "hfa.with_servos": of_servos,
    "trim.sheet_of": of_sheet,
    "trim.graded": of_sheet,
}
#: Why public functions have no answer about a twin -> their names.
WITHOUT = {
    "reads a file, or makes an aircraft of a table": (
        "hfa.read_critic",
        "hfa.conditions",
        "hfa.load_model",
        "hfa.from_derivatives",
        "controller.critic_in",
        "controller.load_game",
        "trim.load_condition",
    ),
    "has a function of hfa for users": ("trim.linearize", "trim.sweep"),
    "about the paper's aircraft": (
        "hfa.aircraft",
        "trim.compare",
        "trim.entry_bands",
        "verification.regenerate_all",
    ),
    "shows a result as text or figure": (
        "trim.trim_report",
        "trim.linear_model_report",
        "trim.trim_figure",
        "trim.draw_bode",
        "controller.expansion_report",
        "controller.solution_report",
        "verification.verdict_figure",
        "verification.verdict_report",
    ),
    "has no aircraft among its arguments": ("controller.basis",),
    "compares two arrays": ("verification.relative_error",),
}
#: Functions compared with twins in named units alone: their rows depend on the unit's name.
NAMED_UNITS_ONLY = ("trim.sheet_of", "trim.graded")
#: Functions with times in seconds by definition (samples, the drift of a state): the equations of
#: their twins keep the second as the unit of time.
TIMES_IN_SECONDS = (
    "hfa.with_servos",
    "hfa.filter",
    "hfa.keep_inside",
    "hfa.assess",
    "hfa.environment",
    "hfa.predictive",
)
#: Functions that take more than a second.
SLOW = (
    "hfa.optimize",
    "hfa.predictive",
    "controller.radii_of",
    "hfa.assess",
    "hfa.identify",
    "hfa.state_dependent",
    "hfa.keep_inside",
    "hfa.environment",
    "hfa.from_network",
)


def public_functions():
    """Yield each public function once, by its first name."""
    seen = set()
    for package in (hfa, trim, controller, verification):
        for name in dir(package):
            found = getattr(package, name)
            if callable(found) and not inspect.isclass(found) and found not in seen:
                seen.add(found)
                yield f"{package.__name__}.{name}"


def test_each_public_function_has_an_answer_or_a_reason():
    """Each public function is once in `ANSWERS` or in `WITHOUT`."""
    assert sorted([*ANSWERS, *chain(*WITHOUT.values())]) == sorted(public_functions())


def differences(found, expected):
    """Return the answers (name, found, expected) that differ: texts that are not equal, and numbers
    that differ by more than 1e-6 of themselves and 1e-9 of the largest one.
    """
    wrong = []
    for name in found:
        answer = expected[name]
        if isinstance(answer, str):
            same = found[name] == answer
        else:
            numbers = np.asarray(answer)
            largest = np.abs(numbers[np.isfinite(numbers)]).max(initial=0.0)
            same = np.allclose(found[name], numbers, rtol=1e-6, atol=1e-9 * largest, equal_nan=True)
        if not same:
            wrong.append((name, found[name], answer))
    return wrong


def cases():
    """Yield public functions with the twins whose answers are compared."""
    for name, answers in ANSWERS.items():
        if name != next(each for each, other in ANSWERS.items() if other == answers):
            continue  # the same answers by another name
        for twin in TWINS:
            if twin.startswith("scaled") and name in NAMED_UNITS_ONLY:
                continue
            slow = name in SLOW or not twin.endswith("0")
            yield pytest.param(name, twin, marks=[pytest.mark.slow] * slow)


@functools.cache
def answers_in_si(name):
    return ANSWERS[name](SI)


@pytest.mark.parametrize(("name", "twin"), cases())
def test_an_answer_does_not_depend_on_units(name, twin):
    """A public function has the same answers about the aircraft in SI units and about its twin, the
    same aircraft in other units; answers are converted to SI units.
    """
    in_other_units = TWINS[twin](seconds=name in TIMES_IN_SECONDS)
    assert differences(ANSWERS[name](in_other_units), answers_in_si(name)) == []
