"""The units of a critic's file and of the plant: V and u are the same functions."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from controller import basis
from controller.game.array_file import PlantNames, file_scales, in_scales, read_arrays
from hfa_support import BadInputError

FOOT = 0.3048


def test_value_and_gain_are_the_same_functions() -> None:
    random, psi = np.random.default_rng(1), basis("quadratic+quartic", 3)
    scales = file_scales({"state_units": ["m/s", "rad", "ft"]}, PlantNames(state_units=("ft/s", "rad", "m")))
    np.testing.assert_allclose(scales, [FOOT, 1.0, 1.0 / FOOT], rtol=1e-15)
    W, root, K = random.normal(size=psi.size), random.normal(size=(3, 3)), random.normal(size=(2, 3))
    P, x = root @ root.T, random.normal(size=3)
    found = in_scales({"W": W, "P": P, "K": K}, scales, psi)
    assert found["W"] @ psi.psi(x) == pytest.approx(W @ psi.psi(scales * x), rel=1e-13)
    assert x @ found["P"] @ x == pytest.approx((scales * x) @ P @ (scales * x), rel=1e-13)
    np.testing.assert_allclose(found["K"] @ x, K @ (scales * x), rtol=1e-13)


@pytest.mark.parametrize("said", [(), ["m/s"], ["", "rad"], [1.0, 2.0], [["m/s"], "rad"], [b"m/s", b"\x93"]])
def test_what_is_not_said_is_not_converted(said: object) -> None:
    assert np.array_equal(file_scales({"state_units": said}, PlantNames(state_units=("ft/s", "rad"))), [1.0, 1.0])
    assert np.array_equal(file_scales({}, PlantNames(state_units=("", ""))), [1.0, 1.0])


def test_other_units_are_refused() -> None:
    with pytest.raises(BadInputError, match="state 2 is in deg and that of the plant in rad; convert it, or leave"):
        file_scales({"state_units": ["ft/s", "deg"]}, PlantNames(state_units=("ft/s", "rad")))


@pytest.mark.parametrize("key", ["states", "inputs"])
def test_the_plant_s_names_in_another_order_are_refused(key: str) -> None:
    plant = PlantNames(("speed", "alpha"), ("speed", "alpha"), ("ft/s", "rad"))
    with pytest.raises(BadInputError, match=f"its {key} are in the order alpha, speed; .* are speed, alpha: reorder"):
        file_scales({key: ["alpha", "speed"]}, plant)
    for others in (["speed", "alpha"], ["x", "y"], ["alpha"], [1.0, 2.0], []):
        assert np.array_equal(file_scales({key: others}, plant), [1.0, 1.0])


@pytest.mark.parametrize("order", "<>")
def test_letters_that_are_none_are_refused(tmp_path: Path, order: str) -> None:
    codes = np.array([[115, 112], [0x110000, 100]], dtype=f"{order}u4")
    for last, right in ((0x110000, False), (0x10FFFF, True)):
        codes[1, 0] = last
        np.savez(tmp_path / "names.npz", states=codes.view(f"{order}U2"), empty=np.array([], dtype="U1"))
        if right:
            assert read_arrays(tmp_path / "names.npz")["states"].shape == (2, 1)
        else:
            with pytest.raises(BadInputError, match="states holds letters that are none"):
                read_arrays(tmp_path / "names.npz")
