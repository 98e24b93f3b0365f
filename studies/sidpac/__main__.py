"""Confidence bands of `hfa identify` compared with Cramér-Rao bounds printed by NASA's SIDPAC.

`python -m studies.sidpac [COUNT]` prints the table of README.md for COUNT records (default 24).

The aircraft is the Twin Otter of example 6.1 of Klein and Morelli. SciPy simulates the aircraft
with the printed derivatives and the recorded inputs. White noise of the size of the printed
residuals is added. The search begins 30 % above or below each printed value.
"""

from __future__ import annotations

import sys
import tomllib
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from scipy.signal import lsim

from hfa import Signal, identify
from hfa_aircraft.model import Model
from hfa_identify.identified import Identified

#: Printed numbers of example 6.1.
SOURCE: dict[str, Any] = tomllib.loads((Path(__file__).parent / "twin_otter.toml").read_text())
#: Parameter -> its printed estimate, and its printed standard deviation.
PRINTED = {name: each["value"] for name, each in SOURCE["parameters"].items()}
DEVIATIONS = {name: each["deviation"] for name, each in SOURCE["parameters"].items()}
STATES = ("beta", "roll_rate", "yaw_rate", "roll")
INPUTS = ("aileron", "rudder")
#: Half-width of a 95 % band in standard deviations.
_HALF_WIDTH = 1.96
#: Relative error of the initial values.
_OFF = 0.3
#: Relative step of the finite differences.
_STEP = 1e-4


def main(words: Sequence[str]) -> int:
    """Print a table row for each parameter, and count the bands that contain the printed estimates.

    words: [COUNT], the number of records
    """
    count = int(words[0]) if words else 24
    found = [identified(seed) for seed in range(count)]
    known, unknown = bounds(start_known=True), bounds(start_known=False)
    print(
        "| parameter | printed | deviation | SciPy, start known | SciPy | `hfa identify` | held |"
    )
    print("| --- | --- | --- | --- | --- | --- | --- |")
    held_of_all = 0
    for name, printed in PRINTED.items():
        bands = [each.parameters[name] for each in found]
        widths = [(band.high - band.low) / 2.0 / _HALF_WIDTH for band in bands]
        held = sum(band.low < printed < band.high for band in bands)
        held_of_all += held
        deviation = DEVIATIONS[name]
        ratios = [known[name], unknown[name], float(np.mean(widths))]
        cells = [name, f"{printed:.4g}", f"{deviation:.2g}"]
        cells += [f"{each / deviation:.2f}" for each in ratios]
        print(f"| {' | '.join([*cells, f'{held} of {count}'])} |")
    print()
    print(f"{held_of_all} of {count * len(PRINTED)} bands hold the printed estimate.")
    print(f"{sum(each.ok for each in found)} of {count} are PASS.")
    return 0


def identified(seed: int) -> Identified:
    """Return the parameters identified from a simulated record whose noise has this seed."""
    rng = np.random.default_rng(seed)
    values = {name: value * (1.0 + _OFF * rng.choice([-1, 1])) for name, value in PRINTED.items()}
    return identify(lateral_model().with_parameters(**values), record(rng), list(PRINTED))


def record(rng: np.random.Generator) -> dict[str, np.ndarray]:
    """Return the columns of a simulated record with noise, by name."""
    times, inputs = manoeuvre()
    measured = response(PRINTED, np.zeros(len(STATES)))
    deviations = np.array(list(SOURCE["residuals"].values()))
    measured += deviations * rng.standard_normal(measured.shape)
    columns = {"time": times} | dict(zip(INPUTS, inputs.T, strict=True))
    return columns | dict(zip(SOURCE["residuals"], measured.T, strict=True))


def manoeuvre() -> tuple[np.ndarray, np.ndarray]:
    """Return the times (samples,) in s, and aileron and rudder (samples, 2) in rad.

    The inputs are interpolated linearly between recorded points.
    """
    read = SOURCE["inputs"]
    times = SOURCE["record"]["interval"] * np.arange(SOURCE["record"]["samples"])
    return times, np.transpose([np.interp(times, read["time"], read[name]) for name in INPUTS])


def response(parameters: Mapping[str, float], start: np.ndarray) -> np.ndarray:
    """Return the outputs (samples, outputs) that SciPy simulates from the initial state `start`."""
    times, inputs = manoeuvre()
    with_bias = np.column_stack([inputs, np.ones(len(times))])
    system = matrices(parameters)
    return np.asarray(lsim(system, with_bias, times, X0=start)[1])


def matrices(parameters: Mapping[str, float]) -> tuple[np.ndarray, ...]:
    """Return A, B, C, D of the lateral model.

    x = (beta, p, r, phi), u = (aileron, rudder, 1), y = (x, lateral acceleration)
    """
    a, p = SOURCE["aircraft"], parameters
    turn = a["span"] / (2.0 * a["speed"])
    force = a["pressure"] * a["area"] / (a["mass"] * a["speed"])
    moment = a["pressure"] * a["area"] * a["span"]
    inertia = np.array([[a["roll"], a["cross"]], [a["cross"], a["yaw"]]])
    damping = moment * inertia @ np.array([
        [p["Cl_beta"], turn * p["Cl_p"], turn * p["Cl_r"], 0.0],
        [p["Cn_beta"], turn * p["Cn_p"], turn * p["Cn_r"], 0.0],
    ])  # fmt: skip
    control = moment * inertia @ np.array([
        [p["Cl_aileron"], p["Cl_rudder"]],
        [p["Cn_aileron"], p["Cn_rudder"]],
    ])  # fmt: skip
    side = force * p["CY_beta"], force * turn * p["CY_r"], force * p["CY_rudder"]
    A = np.array([
        [side[0], a["sin_alpha"], side[1] - a["cos_alpha"], a["beta_rate_by_roll"]],
        *damping,
        [0.0, 1.0, a["tan_pitch"], 0.0],
    ])  # fmt: skip
    B = np.array([
        [0.0, side[2], p["Y_0"]],
        [*control[0], p["L_0"]],
        [*control[1], p["N_0"]],
        [0.0, 0.0, p["P_0"]],
    ])  # fmt: skip
    g = a["speed"] / a["gravity"]
    C = np.vstack([np.eye(4), [g * side[0], 0.0, g * side[1], 0.0]])
    D = np.vstack([np.zeros((4, 3)), [0.0, g * side[2], p["A_0"]]])
    return A, B, C, D


def bounds(*, start_known: bool) -> dict[str, float]:
    """Return the Cramér-Rao bound of each parameter's standard deviation, by name.

    Sensitivities are central differences of the response that SciPy simulates.

    start_known: whether the initial state is known, as in SIDPAC
    """
    rest = np.zeros(len(STATES))
    columns = []
    for name, value in PRINTED.items():
        step = _STEP * abs(value)
        above, below = (
            response({**PRINTED, name: value + sign * step}, rest) for sign in (1.0, -1.0)
        )
        columns.append((above - below) / (2.0 * step))
    if not start_known:
        calm = response(PRINTED, rest)
        columns += [response(PRINTED, start) - calm for start in np.eye(len(STATES))]
    weighted = np.array(columns) / np.array(list(SOURCE["residuals"].values()))
    sensitivities = weighted.reshape(len(columns), -1)
    covariance = np.linalg.inv(sensitivities @ sensitivities.T)
    return dict(zip(PRINTED, np.sqrt(np.diag(covariance)), strict=False))


def lateral_model() -> Model:
    """Return the lateral model, whose parameters are the derivatives and biases."""
    a = SOURCE["aircraft"]
    turn = a["span"] / (2.0 * a["speed"])
    force = a["pressure"] * a["area"] / (a["mass"] * a["speed"])
    moment = a["pressure"] * a["area"] * a["span"]

    def equations(x: Any, u: Any, p: Any, w: Any) -> Any:
        p_hat, r_hat = turn * x.roll_rate, turn * x.yaw_rate
        CY = p.CY_beta * x.beta + p.CY_r * r_hat + p.CY_rudder * u.rudder
        Cl = p.Cl_beta * x.beta + p.Cl_p * p_hat + p.Cl_r * r_hat
        Cl += p.Cl_aileron * u.aileron + p.Cl_rudder * u.rudder
        Cn = p.Cn_beta * x.beta + p.Cn_p * p_hat + p.Cn_r * r_hat
        Cn += p.Cn_aileron * u.aileron + p.Cn_rudder * u.rudder
        gravity = a["beta_rate_by_roll"] * x.roll
        turning = a["sin_alpha"] * x.roll_rate - a["cos_alpha"] * x.yaw_rate
        rates = {
            "beta": force * CY + turning + gravity + p.Y_0,
            "roll_rate": moment * (a["roll"] * Cl + a["cross"] * Cn) + p.L_0,
            "yaw_rate": moment * (a["cross"] * Cl + a["yaw"] * Cn) + p.N_0,
            "roll": x.roll_rate + a["tan_pitch"] * x.yaw_rate + p.P_0,
        }
        acceleration = force * a["speed"] / a["gravity"] * CY + p.A_0
        return rates, {"lateral_acceleration": acceleration}

    return Model(
        name="Twin Otter",
        states={name: Signal("rad", 0.1) for name in STATES},
        inputs={name: Signal("rad", 0.1) for name in INPUTS},
        parameters={name: Signal("1", abs(value), start=value) for name, value in PRINTED.items()},
        outputs={"lateral_acceleration": Signal("1", 0.1)},
        equations=equations,
    )


if __name__ == "__main__":
    raise SystemExit(main(sys.argv[1:]))
