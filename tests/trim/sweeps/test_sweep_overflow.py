"""Numbers far from any aircraft's: one line that says so, a row with its status in a sweep, never a traceback."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa

from hfa_model import Aircraft, Parameters, ParameterSet, save_parameters
from hfa_support import BadInputError
from trim import find_operating_point, level_flight, release, sweep
from trim.sweeps.chunk import NO_TRIM, TRIMMED, run_chunk

WORDS = "the equations overflow or divide by zero at this condition with these parameters"
#: The parameter and a value at which the first guess, the rates or their Jacobian overflow.
EXTREMES = [("lift_slope", 1e200), ("inertia_pitch", 1e-300), ("panel_mass", 1e300), ("chord", 1e-300)]


@pytest.mark.parametrize(("name", "value"), EXTREMES)
@pytest.mark.parametrize("free", [(), ("aileron_center",)])
def test_an_extreme_parameter_is_refused(
    parameters: Parameters, name: str, value: float, free: tuple[str, ...]
) -> None:
    with pytest.raises(BadInputError, match=f"{WORDS}; take values"):
        find_operating_point(Aircraft(parameters._replace(**{name: value})), release(level_flight(0.0), free=free))


@pytest.mark.parametrize(
    ("names", "said"),
    [
        (["thrust_per_throttle"], "of which thrust_per_throttle is zero; take"),
        (["lift_slope"], "of which lift_slope is zero; take"),
        (["panel_mass", "lift_slope"], "of which panel_mass and lift_slope are zero; take"),
    ],
)
def test_parameters_of_zero_are_named(parameters: Parameters, names: list[str], said: str) -> None:
    aircraft = Aircraft(parameters._replace(**dict.fromkeys(names, 0.0)))
    with pytest.raises(BadInputError, match=f"{WORDS}, {said}"):
        find_operating_point(aircraft, level_flight(0.0))


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize(("name", "value"), [("panel_mass", 1e-100), ("panel_span", 1e30)])
def test_an_overflow_inside_the_search_is_refused_without_a_warning(
    parameters: Parameters, name: str, value: float
) -> None:
    with pytest.raises(BadInputError, match=WORDS):
        find_operating_point(Aircraft(parameters._replace(**{name: value})), level_flight(0.0))


def test_an_extreme_speed_is_refused() -> None:
    words = ("trim", "--dihedral", "15", "--limit", "speed=0:1", "--speed", "1e-200")
    assert_refused(hfa(*words), 2, WORDS)


@pytest.mark.parametrize(("name", "value"), EXTREMES)
@pytest.mark.parametrize("command", ["trim", "linearize"])
def test_a_parameters_file_is_refused(
    parameter_set: ParameterSet, tmp_path: Path, name: str, value: float, command: str
) -> None:
    path = tmp_path / "extreme.toml"
    save_parameters(replace(parameter_set, values=parameter_set.values._replace(**{name: value})), path, "")
    assert_refused(hfa(command, "--dihedral", "0", "--parameters", str(path)), 2, WORDS)


@pytest.mark.parametrize(("name", "value"), EXTREMES)
def test_in_a_sweep_it_is_a_row(parameters: Parameters, name: str, value: float) -> None:
    reasons = sweep(Aircraft(parameters._replace(**{name: value})), {"dihedral": [0.0, 0.2]}).reasons
    assert WORDS in reasons[0]
    ordinary = getattr(parameters, name)
    chunk = run_chunk((name,), np.array([[value], [ordinary]]), parameters, "published")
    assert chunk.status.tolist() == [NO_TRIM, TRIMMED]
    assert np.isfinite(chunk.A[1]).all()
