"""Files of scheduled controllers: read again as they were, in the layout of other tools, refused when damaged."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from controllers import small_controller
from scipy.io import loadmat

from controller import load_controller, save_controller
from hfa_model import Aircraft
from hfa_support import BadInputError


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
    refused("about.npz", "its content: about is 5; make it the table", about="5")
    for name in ("good.json", "good.mat"):
        with pytest.raises(BadInputError, match=f"{name}: a controller is read from a .npz file"):
            load_controller(tmp_path / name)
    with pytest.raises(BadInputError, match=r"a controller is written as \.npz or \.mat"):
        save_controller(tmp_path / "good.json", small_controller(published_aircraft))
