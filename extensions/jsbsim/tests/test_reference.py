"""Accelerations and engines compared with JSBSim, which runs in a separate process."""

import numpy as np
import pytest
from constructs.judge import difference, ours_at
from jsbsim_reference import measured
from small_aircraft import needs_jsbsim

from hfa import load_model
from hfa_jsbsim.aircraft_files import data_folder

pytestmark = needs_jsbsim
#: Aircraft for which this comparison is not possible: they are refused, their engine stops, or
#: JSBSim moves their surfaces depending on past states. JSBSim also ignores fuel tanks while no
#: engine burns. Accelerations of the fokker50 are not finite at one point in JSBSim.
OTHERS = {
    *("F450", "J246", "L410", "Pterosaur", "Submarine_Scout", "ZLT-NT", "ah1s", "blank", "c172x"),
    *("c310", "f16", "f22", "fokker50", "weather-balloon", "x24b"),
}
#: Aircraft whose propellers or engine governors have not settled after two minutes.
SLOW = {"Short_S23": 1e-3, "wrightFlyer1903": 1e-7}


def compared():
    """Return the names of JSBSim's aircraft that are compared, none without JSBSim."""
    folder = data_folder()
    if folder is None:
        return []
    names = {path.name for path in (folder / "aircraft").iterdir() if path.is_dir()}
    return sorted(names - OTHERS)


def random_points(model, count, seed=1):
    """Return random states and pilot commands, in the format of `measured`."""
    rng = np.random.default_rng(seed)
    usual = model.states["speed"].start
    points = []
    for _ in range(count):
        state = {
            "altitude": rng.uniform(1000.0, 20000.0),
            "speed": usual * rng.uniform(1.0, 2.0),
            "alpha": rng.uniform(-0.05, 0.2),
            "beta": rng.uniform(-0.1, 0.1),
            "roll": rng.uniform(-0.6, 0.6),
            "pitch": rng.uniform(-0.3, 0.3),
            "roll_rate": rng.uniform(-0.1, 0.1),
            "pitch_rate": rng.uniform(-0.1, 0.1),
            "yaw_rate": rng.uniform(-0.1, 0.1),
        }
        commands = {name: rng.uniform(-1.0, 1.0) for name in ("aileron", "elevator", "rudder")}
        commands["throttle"] = rng.uniform(0.2, 1.0)
        points.append({"state": state, "commands": commands})
    return points


def misses(name, count):
    """Return the largest relative differences from JSBSim at random points, (3,): of accelerations,
    of the thrust, and of the accelerations of propellers, which are 0 in JSBSim.

    count: number of points
    """
    model = load_model(f"jsbsim:{name}")
    points = random_points(model, count)
    worst = np.zeros(3)
    for point, answer in zip(points, measured(name, points), strict=True):
        # Systems of JSBSim move fuel between tanks; the model keeps the contents of the file.
        answer = {key: value for key, value in answer.items() if not key.startswith("tank")}
        _, rates, outputs = ours_at(model, point, answer)
        thrust = sum(value for key, value in answer.items() if key.startswith("thrust"))
        turning = [
            abs(rates[key]) / model.states[key].rate for key in rates if key.startswith("rpm")
        ]
        miss = [
            difference(model, point, answer),
            abs(outputs["thrust"] - thrust) / max(1.0, abs(thrust)),
            max(turning, default=0.0),
        ]
        worst = np.maximum(worst, miss)
    return worst


def test_a_glider_accelerates_as_in_jsbsim():
    """At two random states and commands, the accelerations of the SGS 1-26 agree to 1e-12."""
    acceleration, *_ = misses("sgs126", 2)
    assert acceleration < 1e-12


@pytest.mark.slow
@pytest.mark.parametrize("name", compared())
def test_all_aircraft_accelerate_as_in_jsbsim(name):
    """At five random points, accelerations and thrust agree with JSBSim to a relative 1e-9.

    JSBSim is run until its engines have settled, or for two minutes (`SLOW`). At its propeller
    speeds, the propellers of the model are in equilibrium.
    """
    acceleration, thrust, turning = misses(name, 5)
    tolerance = SLOW.get(name, 1e-9)
    assert acceleration < tolerance
    assert thrust < tolerance
    assert turning < 10.0 * tolerance
