"""The scheduled controller: its interpolation, whom it refuses, its files and its report."""

from __future__ import annotations

import math
from pathlib import Path

import numpy as np
import pytest
from controllers import small_controller
from scipy.io import loadmat

from controller import load_controller, save_controller
from hfa_model import Aircraft, default_parameters
from hfa_support import BadInputError
from hfa_support.reporting.text import Table


@pytest.mark.parametrize(
    ("degrees", "shares"),
    [(5.0, (1, 0, 0)), (7.5, (0.5, 0.5, 0)), (18.0, (0, 0.2, 0.8)), (-30.0, (1, 0, 0)), (60.0, (0, 0, 1))],
)
def test_matrices_are_linear_between_the_angles(
    published_aircraft: Aircraft, degrees: float, shares: tuple[float, ...]
) -> None:
    controller = small_controller(published_aircraft)
    expected = np.dot(shares, np.arange(3.0))
    for number, matrix in enumerate(controller.at(math.radians(degrees))):
        np.testing.assert_allclose(matrix, expected + 10.0 * number, rtol=1e-12)


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"A": np.zeros((3, 2, 2))}, r"A is \(3, 2, 2\); it must be \(3, 1, 1\)"),
        ({"D": np.full((3, 1, 4), math.nan)}, "D has a number that is not finite"),
        ({"places": np.array([0.2, 0.1, 0.3])}, "dihedrals must increase"),
        ({"measurements": ("pitch_rate", "lift")}, "unknown measurement 'lift'"),
        ({"states": ("A = 1000",)}, "a state is called 'A = 1000'; give letters, digits and _ as in C"),
        ({"commands": ("dihedral_command", "dihedral_wish")}, "unknown command 'dihedral_wish'"),
        ({"command_filter": (0.5,)}, "command_filter must be a bandwidth and a damping"),
    ],
)
def test_what_no_flight_could_rely_on_is_refused(
    published_aircraft: Aircraft, changed: dict[str, object], message: str
) -> None:
    with pytest.raises(BadInputError, match=f"controller small: {message}"):
        small_controller(published_aircraft, **changed)


def test_another_aircraft_and_other_angles_are_refused(published_aircraft: Aircraft) -> None:
    controller = small_controller(published_aircraft)
    controller.refuse_other(published_aircraft, math.radians(5.0), math.radians(20.0))
    with pytest.raises(BadInputError, match="covers dihedral 5 to 20 deg; 4 to 11 deg is asked for"):
        controller.refuse_other(published_aircraft, math.radians(4.0), math.radians(11.0))
    with pytest.raises(BadInputError, match="designed for published dynamics, the aircraft has newton"):
        controller.refuse_other(Aircraft(dynamics="newton"), 0.1, 0.2)
    heavier = default_parameters().values._replace(panel_mass=11.0)
    with pytest.raises(BadInputError, match="an aircraft with other parameters"):
        controller.refuse_other(Aircraft(heavier), 0.1, 0.2)


def test_a_file_gives_the_controller_back(published_aircraft: Aircraft, tmp_path: Path) -> None:
    saved = small_controller(published_aircraft)
    save_controller(tmp_path / "small.npz", saved)
    found = load_controller(tmp_path / "small.npz")
    assert found == saved
    assert found.about == saved.about
    assert found != small_controller(published_aircraft, name="other")


def test_matlab_gets_stacks_with_the_angle_last(published_aircraft: Aircraft, tmp_path: Path) -> None:
    controller = small_controller(published_aircraft)
    save_controller(tmp_path / "small.mat", controller)
    found = loadmat(tmp_path / "small.mat")
    assert found["B"].shape == (1, 4, 3)
    np.testing.assert_array_equal(np.moveaxis(found["B"], -1, 0), controller.B)
    assert [name.item() for name in found["measurements"].ravel()] == ["pitch_rate", "dihedral"]


def test_what_is_no_controller_is_refused(published_aircraft: Aircraft, tmp_path: Path) -> None:
    def refused(name: str, message: str, **changed: object) -> None:
        with np.load(tmp_path / "good.npz") as good:
            content = {key: value for key, value in ({**good} | changed).items() if value is not None}
        np.savez(tmp_path / name, **content)
        with pytest.raises(BadInputError, match=f"{name}: {message}"):
            load_controller(tmp_path / name)

    save_controller(tmp_path / "good.npz", small_controller(published_aircraft))
    refused("plant.npz", "this is no controller file", schema="hfa.plant/1")
    refused("short.npz", "W is missing", W=None)
    refused("shape.npz", r"controller small: A is \(1, 1, 1\)", A=np.zeros((1, 1, 1)))
    refused("text.npz", "its content is damaged", A=np.array(["x"]))
    refused("about.npz", "its content is damaged", about="{")
    refused("about.npz", "its content is damaged", about="5")
    refused("about.npz", r"its content: angles\[0\].checks is missing", about='{"angles": [{"dihedral": 0.1}]}')
    for name in ("good.json", "good.mat"):
        with pytest.raises(BadInputError, match=f"{name}: a controller is read from a .npz file"):
            load_controller(tmp_path / name)
    with pytest.raises(BadInputError, match=r"a controller is written as \.npz or \.mat"):
        save_controller(tmp_path / "good.json", small_controller(published_aircraft))


@pytest.mark.parametrize("limit", ["delta_min", "gamma_min"])
def test_its_table_has_the_limit_and_the_certificate_of_each_angle(published_aircraft: Aircraft, limit: str) -> None:
    rows = [
        {"dihedral": math.radians(degrees), limit: 7.25, "checks": [{"ok": True}, {"ok": ok}]}
        for degrees, ok in ((5.0, True), (10.0, False), (20.0, True))
    ]
    report = small_controller(published_aircraft, about={"delta": 200.0, "angles": rows}).report()
    table = report.parts[1]
    assert isinstance(table, Table)
    assert [tuple(map(str, each)) for each in table.rows][1] == ("10", "7.25", "FAIL")
    assert (report.data["delta"], report.data["angles"]) == (200.0, rows)
