"""Points of sweeps equal single trims, in memory and in a store. Faulty sweeps are refused."""

import csv

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from project import ROOT

from hfa import (
    Model,
    Signal,
    aircraft as aircraft_of,
    linearize,
    load_model,
    sweep,
    trim,
)
from trim import TrimError, load_condition, release, trim_points, usual_condition

LEVEL_FLIGHT = usual_condition(aircraft_of())
TRIMMED, BEYOND_LIMITS, NO_TRIM = range(3)

ALPHA_FREE = release(LEVEL_FLIGHT, free=("alpha",), hold={"aileron_outer": 0.0})
LIMITED = release(LEVEL_FLIGHT, limits={"throttle": (0.0, 40.0)})
#: Name -> grid and condition.
CASES = {
    "limits": ({"dihedral": [0.05, 0.2]}, LIMITED),
    "released simulation": ({"dihedral": [0.1, 0.3]}, load_condition("simvfa-64")),
    "alpha free, limited": (
        {"speed": [40.0, 68.0]},
        release(ALPHA_FREE, limits={"alpha": (0.0, 0.09)}),
    ),
    "gamma free, limited": (
        {"throttle": [0.0, 60.0]},
        release(LEVEL_FLIGHT, free=("gamma",), limits={"gamma": (-0.02, 0.1)}),
    ),
    "least effort": ({"speed": [64.0, 68.0]}, release(LEVEL_FLIGHT, free=("alpha",))),
    "slow": (
        {"dihedral": [0.0, 0.2], "speed": [30.0, 68.0], "altitude": [5e3, 4e4]},
        LEVEL_FLIGHT,
    ),
    "mass": ({"panel_mass": [10.0, 11.0], "dihedral": [0.1]}, LEVEL_FLIGHT),
}


@pytest.mark.parametrize("name", CASES)
def test_each_point_equals_its_single_trim(published_aircraft, name):
    """Each point of a sweep equals its single trim and linear model. A point without a trim has the reason
    that the error of the single trim states.

    One point of each grid with limits has no trim, and neither have the four of "slow" at 30 ft/s.
    """
    grid, condition = CASES[name]
    result = sweep(published_aircraft, grid, condition=condition)
    for i, row in enumerate(result.values):
        held = dict(zip(result.variables, row.tolist(), strict=True))
        held.pop("panel_mass", None)  # a parameter of the model, set below
        single = condition.at(held.pop("dihedral")) if "dihedral" in held else condition
        single = release(single, hold=held)
        model = published_aircraft
        if name == "mass":
            model = model.with_parameters(panel_mass=float(row[0]))
        if result.reasons[i]:
            with pytest.raises(TrimError) as caught:
                trim(model, single)
            assert result.reasons[i] == str(caught.value)
            assert " required" in result.reasons[i]
            continue
        point = trim(model, single)
        np.testing.assert_allclose(result.states[i], point.states, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result.inputs[i], point.inputs, rtol=1e-9, atol=1e-11)
        np.testing.assert_allclose(result.A[i], linearize(model, point).A, rtol=1e-9, atol=1e-9)
    untrimmed = {"slow": 4} | {each: 1 for each in CASES if "limit" in each}
    assert np.count_nonzero(~result.trimmed) == untrimmed.get(name, 0)


def test_a_listed_point_outside_a_limit_fails_alone(tmp_path):
    """Of three listed points, the speed 99000 ft/s and the temperature isa = 120 K are outside their
    limits; each has its own reason, and the first point is trimmed.
    """
    path = tmp_path / "points.csv"
    path.write_text("speed,isa\n220,10\n99000,10\n220,120\n", encoding="utf-8")
    table = str(ROOT / "examples" / "cessna182.toml")
    result = hfa("sweep", "--aircraft", table, "--conditions", str(path))
    said = " ".join(result.out.split())
    assert result.code == 0
    assert "trimmed at 1 of 3 points" in said
    assert "99000, 10: speed is 99000 ft/s; give a value between" in said
    assert "220, 120: isa is 120 K; give at most 100 K" in said


def test_files_of_points_that_are_trimmed_stalled_or_have_no_trim(tmp_path, monkeypatch):
    """With CL_max = 1.1, the UAV stalls at 18.5 m/s and has no trim at 14 m/s: states, inputs, eigenvalues,
    A and B are then NaN in the CSV file, which names the modes. A store has the same counts.
    """
    text = (ROOT / "examples" / "uav.toml").read_text("utf-8")
    plane, path = tmp_path / "uav.toml", tmp_path / "swept.csv"
    plane.write_text(text.replace("[longitudinal]", "[longitudinal]\nCL_max = 1.1"), "utf-8")
    words = ("sweep", "--aircraft", str(plane), "--hold", "speed=14,18.5,25", "-o")
    assert hfa(*words, str(path)).code == 0
    with path.open(newline="", encoding="utf-8") as stream:
        untrimmed, stalled, trimmed = csv.DictReader(stream)
    assert [row["results"] for row in (stalled, trimmed)] == ["stalled", "trimmed"]
    numbers = [name for name in trimmed if "eigenvalue" in name or name[:2] in ("A(", "B(")]
    numbers += ["alpha [deg]", "elevator [deg]"]
    assert {untrimmed[name] for name in numbers} == {"NaN"}
    assert "NaN" not in {trimmed[name] for name in numbers}
    modes = trim(load_model(str(plane)), hold={"speed": 25.0}).linearize().modes
    (spiral,) = (mode.eigenvalue.real for mode in modes if mode.name == "spiral")
    assert float(trimmed["spiral eigenvalue real [1/s]"]) == pytest.approx(spiral, abs=1e-9)
    monkeypatch.setattr("trim.sweeps.result._MANY_SLOW", 1)  # notes few such points
    stored = answer(*words, str(tmp_path / "swept.zarr"))
    assert stored["warnings"][0].startswith("1 of 3 points were trimmed one by one")
    assert stored["stalled"] == 1
    assert stored["counts"] == {"missing": 0, "trimmed": 2, "beyond limits": 0, "no trim": 1}


def test_modes_of_listed_points_keep_their_columns():
    """Points of a list have no neighbors in a grid: their modes are those of the models of single points,
    also beyond one without a trim.
    """
    done, plane = [], load_model(str(ROOT / "examples" / "uav.toml"))
    axes = {"speed": [25.0, 14.0, 35.0], "altitude": [100.0, 100.0, 3000.0]}
    swept = sweep(plane, axes, listed=True, progress=lambda *part: done.append(part))
    assert done[-1][:2] == (3, 3)  # the point without a trim is sought alone
    for i in (0, 2):
        single = {name: values[i] for name, values in axes.items()}
        modes = trim(plane, hold=single).linearize().modes
        for name, value in zip(swept.mode_names, swept.eigenvalues[i], strict=True):
            found = [mode.eigenvalue for mode in modes if mode.name == name]
            assert min(abs(value - np.array([*found, *np.conj(found)]))) < 1e-6


# Many points together, compared with single trims.


def test_each_point_has_the_expected_status(published_aircraft):
    """With the controls free, a climb or descent of 20 deg, 30 ft/s, or alpha = 21 deg is possible only
    beyond a limit, and a negative speed not at all. A is finite at trims only.
    """
    statuses = {  # (speed, ft/s; gamma, rad; alpha, rad)
        (68.0, 0.35, 0.0489): BEYOND_LIMITS,
        (68.0, -0.35, 0.0489): BEYOND_LIMITS,
        (30.0, 0.0, 0.0489): BEYOND_LIMITS,
        (68.0, 0.0, 0.36): BEYOND_LIMITS,
        (68.0, 0.0, 0.0489): TRIMMED,
        (-5.0, 0.0, 0.0489): NO_TRIM,
    }
    values = np.array(list(statuses))
    points = trim_points(published_aircraft, ("speed", "gamma", "alpha"), values)
    assert points.status.tolist() == list(statuses.values())
    assert np.isfinite(points.A).all(axis=(1, 2)).tolist() == [
        status == TRIMMED for status in statuses.values()
    ]


# Stores.


WORDS_OF_STORE = (
    *("--dihedral", "5,10", "--hold", "speed=64,68", "--free", "alpha"),
    *("--hold", "aileron_center=20"),  # its limit
)


@pytest.fixture(scope="module")
def store(tmp_path_factory):
    """Write a store of 4 points, all with the aileron at its limit, and return its path."""
    path = tmp_path_factory.mktemp("store") / "a.zarr"
    done = hfa("sweep", *WORDS_OF_STORE, "-o", str(path))
    assert (done.code, "nonsmooth point" in done.err) == (0, False)
    return path


@pytest.mark.parametrize("more", ["", "--limit throttle=0:40", "--hold altitude=1e4", "--units si"])
def test_a_store_is_resumed_with_its_own_sweep_only(more, store):
    """--resume with the options of the stored sweep is accepted. A sweep with another limit, another held
    value or other units is refused.
    """
    words = (*WORDS_OF_STORE, *more.split(), "-o", str(store), "--resume")
    result = hfa("sweep", *words)
    if not more:
        assert result.code == 0
        return
    assert_refused(result, 2, "another sweep")


def test_an_empty_tank_is_at_its_limit():
    """A mass without a lower limit is at least 0: fuel that follows a flow of 0 is at this limit."""
    tank = Model(
        "tank",
        {"fuel": Signal("kg")},
        {"flow": Signal("kg/s")},
        lambda x, u, p, w: ({"fuel": u.flow - x.fuel}, {}),
        trim={"flow": 0.0},
    )
    assert trim(tank).margins["fuel"].at_limit
    swept = sweep(tank, flow=[0.0, 1.0])
    assert swept.at_limit.tolist() == [[-1, 0], [0, 0]]
    assert "fuel lowest" in str(swept.report())
