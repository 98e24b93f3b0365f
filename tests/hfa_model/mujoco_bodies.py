"""Rates of three rigid bodies on two hinges by MuJoCo, with the panels' loads of `hfa_model`.

Run `pip install mujoco` in an environment of its own, then `python tests/hfa_model/mujoco_bodies.py`
in the project's folder: it stores states, inputs and MuJoCo's rates in `mujoco_rates.json`.

The inertias are those that a rigid body can have: MuJoCo refuses the paper's.
"""

import json
from pathlib import Path

import mujoco
import numpy as np

from hfa.paper import default_parameters
from hfa_model import Input, State
from hfa_model.aerodynamics import aircraft_loads
from hfa_model.atmosphere import density
from hfa_model.variants import VARIANTS

COUNT = 50
INERTIAS = {"inertia_roll": 2650.0, "inertia_pitch": 120.0, "inertia_yaw": 2700.0}
P = default_parameters().values._replace(**INERTIAS)
PANEL = f'mass="{P.panel_mass}" diaginertia="{P.inertia_roll} {P.inertia_pitch} {P.inertia_yaw}"'
SPRING = f'stiffness="{P.hinge_stiffness}" damping="{P.hinge_damping}"'
S = P.panel_span
#: x forward, y left, z up; pitching up turns about -y.
BODIES = f"""<mujoco><compiler inertiafromgeom="false" balanceinertia="false"/>
<option gravity="0 0 {-P.gravity}"><flag contact="disable"/></option><worldbody>
<body name="center"><joint type="slide" axis="1 0 0"/><joint type="slide" axis="0 0 1"/>
<joint type="hinge" axis="0 -1 0"/><inertial pos="0 0 0" {PANEL}/>
<body name="left" pos="0 {S / 2} 0"><joint type="hinge" axis="1 0 0" {SPRING}/>
<inertial pos="0 {S / 2} 0" {PANEL}/></body>
<body name="right" pos="0 {-S / 2} 0"><joint type="hinge" axis="-1 0 0" {SPRING}/>
<inertial pos="0 {-S / 2} 0" {PANEL}/></body>
</body></worldbody></mujoco>"""
MODEL = mujoco.MjModel.from_xml_string(BODIES)
STEP = 1e-5


def rates_of(x: State, u: Input) -> list[float]:
    """Return dX/dt by MuJoCo."""
    data = mujoco.MjData(MODEL)
    loads = aircraft_loads(x, u, float(density(x.altitude)), P, VARIANTS["newton"])
    path = x.pitch - x.alpha
    data.qpos[2:] = x.pitch, x.dihedral, x.dihedral
    data.qvel[2:] = x.pitch_rate, x.dihedral_rate, x.dihedral_rate
    relative = velocity_of(data.qpos, data.qvel)
    along = x.speed * np.array([np.cos(path), np.sin(path)])
    data.qvel[:2] = along - relative[[0, 2]]
    mujoco.mj_forward(MODEL, data)
    apply(data, "center", loads.center, 0.0)
    center = data.body("center")
    force = axes(data, "center") @ [float(loads.thrust), 0.0, 0.0]
    mass_center = data.subtree_com[center.id].copy()
    mujoco.mj_applyFT(MODEL, data, force, np.zeros(3), mass_center, center.id, data.qfrc_applied)
    apply(data, "right", loads.outer, -1.0)
    apply(data, "left", loads.outer, 1.0)
    mujoco.mj_forward(MODEL, data)
    after = velocity_of(data.qpos + STEP * data.qvel, data.qvel + STEP * data.qacc)
    before = velocity_of(data.qpos - STEP * data.qvel, data.qvel - STEP * data.qacc)
    forward, _, upward = (after - before) / (2.0 * STEP)
    speed_rate = forward * np.cos(path) + upward * np.sin(path)
    path_rate = (upward * np.cos(path) - forward * np.sin(path)) / x.speed
    dihedral = (data.qacc[3] + data.qacc[4]) / 2.0
    climb = x.speed * np.sin(path)
    rates = State(
        speed=speed_rate,
        alpha=x.pitch_rate - path_rate,
        altitude=climb,
        pitch=x.pitch_rate,
        pitch_rate=data.qacc[2],
        dihedral=x.dihedral_rate,
        dihedral_rate=dihedral,
    )
    return [float(rate) for rate in rates]


def velocity_of(qpos: np.ndarray, qvel: np.ndarray) -> np.ndarray:
    """Return the velocity of the common center of mass, (3,)."""
    data = mujoco.MjData(MODEL)
    data.qpos[:], data.qvel[:] = qpos, qvel
    mujoco.mj_forward(MODEL, data)
    mujoco.mj_subtreeVel(MODEL, data)
    return data.subtree_linvel[data.body("center").id].copy()


def axes(data: mujoco.MjData, name: str) -> np.ndarray:
    """Return the axes of a panel, forward, right and down, as columns in the world."""
    turned = data.body(name).xmat.reshape(3, 3)
    return turned * [1.0, -1.0, -1.0]


def apply(data: mujoco.MjData, name: str, load, inboard: float) -> None:
    """Apply the load of a panel at its center of mass; inboard: sign of inboard along the right."""
    body, turned = data.body(name), axes(data, name)
    sideward = inboard * float(load.sideward) if inboard else 0.0
    force = turned @ [float(load.forward), sideward, float(load.downward)]
    pitching = float(load.moment) + P.boom_length * float(load.tail_downward)
    moment = turned @ [0.0, pitching, 0.0]
    mujoco.mj_applyFT(MODEL, data, force, moment, body.xipos.copy(), body.id, data.qfrc_applied)


if __name__ == "__main__":
    random = np.random.default_rng(777)
    cases = []
    for _ in range(COUNT):
        state = random.uniform(
            [40.0, -0.25, 0.0, -0.8, -0.6, -0.9, -0.9], [110.0, 0.25, 60000.0, 0.8, 0.6, 0.9, 0.9]
        ).tolist()
        controls = random.uniform([0.0, *[-0.3] * 4], [200.0, *[0.3] * 4]).tolist()
        rates = rates_of(State(*state), Input(*controls))
        cases.append({"x": state, "u": controls, "rates": rates})
    stored = {"mujoco": mujoco.__version__, "inertias": INERTIAS, "cases": cases}
    text = json.dumps(stored, indent=None)
    Path(__file__).with_name("mujoco_rates.json").write_text(text + "\n", encoding="utf-8")
