"""Policies for the tests, and their aircraft.

The policies were trained by extensions/flight/tests/support/train_policies.py of commit 92f882fb2.
"""

from functools import cache
from pathlib import Path

import numpy as np

import hfa

FOLDER = Path(__file__).resolve().parent.parent / "policies"
ROOT = FOLDER.parent.parent.parent.parent
GTM = f"{ROOT}/examples/gtm.py:GTM"
#: Zips of Stable-Baselines3 of 3 observations and 2 actions.
ZIPS = ROOT / "tests/controller/critic/network/zips"
#: Weights of the GTM's states and inputs, and standard deviations of its sensors: m/s, rad, rad/s.
Q = {"speed": 0.0025, "alpha": 8.16, "pitch_rate": 1.0, "pitch": 8.16}
R = {"elevator": 1.11, "throttle": 0.00051}
SENSORS = {"speed": 0.1, "alpha": 0.002, "pitch_rate": 0.002, "pitch": 0.002}
#: Policy -> aircraft and trims of its training, or trims nearby.
AIRCRAFT = {
    "ppo_gtm": (GTM, (38.0, 45.0, 52.0, 60.0)),
    "ppo_raw": (GTM, (38.0, 45.0, 52.0, 60.0)),
    "sac_gtm": (GTM, (40.0, 45.0, 52.0)),
    "td3_gtm": (GTM, (45.0, 49.0, 52.0)),
    "a2c_gtm": (GTM, (38.0, 42.0)),
    "ppo_c172": ("jsbsim:c172p", (120.0, 135.0, 150.0)),
    "ppo_hfa": ("", (float(np.radians(8.0)),)),
}
#: Policies with other conventions and hardly any training.
UNTRAINED = {"ppo_squash": (GTM, (45.0,)), "sac_sde": (GTM, (45.0,))}


model_of = cache(hfa.load_model)


def aircraft(name):
    """Return the aircraft of the test policy with this name."""
    where = (AIRCRAFT | UNTRAINED)[name][0]
    return model_of(where) if where else hfa.aircraft()


@cache
def stored_deployment(name):
    """Return the deployment of the test policy with this name."""
    return hfa.Deployment.load(FOLDER / f"{name}.toml")


@cache
def trims(name):
    """Return the trims of the test policy with this name."""
    return tuple(hfa.trim(aircraft(name), at=value) for value in AIRCRAFT[name][1])


def gtm_deployment(policy, **tables):
    """Return a deployment on the GTM that observes all four states as deviations from trim.

    tables: replacements of the tables observation, action and timing
    """
    entries = {
        "observation": {"speed": {}, "alpha": {}, "pitch_rate": {}, "pitch": {}},
        "action": {"elevator": {}, "throttle": {}},
        "timing": {"dt": 0.02},
    }
    return hfa.Deployment(policy=policy, **(entries | tables))
