"""The C files: compiled without a warning, and the same numbers as ours, of the HFA and of other aircraft."""

from __future__ import annotations

import ctypes
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from c_files import called, footprint, loaded, needs_gcc, ran, written
from known_models import model_at
from random_points import INPUT_SCALES, STATE_SCALES, rising, state_rates, symbols

from controller.export.exported_loop import AIRCRAFT_FILES, c_model_texts
from hfa_model import Aircraft
from hfa_support import BadInputError
from hfa_support.model import load_model
from hfa_support.native.c_code import c_function
from trim import OperatingPoint, find_operating_point, linearize
from trim.point.condition import usual_condition

pytestmark = needs_gcc
HEADER, SOURCE, EXAMPLE = AIRCRAFT_FILES
EXAMPLES = Path(__file__).parents[3] / "examples"


@pytest.fixture(scope="module")
def folder(aircraft: Aircraft, tmp_path_factory: pytest.TempPathFactory) -> Path:
    gain = np.arange(30.0).reshape(5, 6) / 100
    texts = c_model_texts(aircraft, model_at(15.0, aircraft.variant.name), gain, "from */ here")
    return written(tmp_path_factory.mktemp("c"), texts, SOURCE)


def test_rates_are_ours(folder: Path, aircraft: Aircraft, point: OperatingPoint) -> None:
    (x, u, p), w = symbols(), ca.SX.sym("w")
    ours = ca.Function("ours", [x, u, p, w], [state_rates(x, u, p, aircraft.variant, rising(w))])
    random, dx = np.random.default_rng(5), np.empty(7)
    for row in range(1000):
        state = np.array(point.states) + 0.5 * np.array(STATE_SCALES) * random.uniform(-1, 1, 7)
        control = np.array(point.inputs) + 0.5 * np.array(INPUT_SCALES) * random.uniform(-1, 1, 5)
        updraft = float(row % 5 - 2)
        called(folder, "hfa_rates", state, control, updraft, dx)
        known = np.array(ours(state, control, np.array(aircraft.parameters), updraft)).ravel()
        np.testing.assert_allclose(dx, known, rtol=1e-14, atol=0)


def test_the_policy_and_the_constants(folder: Path, aircraft: Aircraft) -> None:
    model, gain = model_at(15.0, aircraft.variant.name), np.arange(30.0).reshape(5, 6) / 100
    point = model.point
    x, u = np.array(point.states) + np.arange(7.0) / 10, np.empty(5)
    called(folder, "hfa_policy", x, u)
    np.testing.assert_allclose(u, np.array(point.inputs) - gain @ (np.arange(7.0) / 10)[[0, 1, 3, 4, 5, 6]], rtol=1e-14)
    stored = (ctypes.c_double * 36).in_dll(loaded(folder), "hfa_A")
    np.testing.assert_array_equal(np.array(stored).reshape(6, 6), model.A)
    header = (folder / HEADER).read_text(encoding="utf-8")
    assert "HFA_PITCH_RATE, /* rad/s */" in header
    assert "from * / here" in header


@pytest.mark.parametrize("aircraft", ["published", pytest.param("newton", marks=pytest.mark.slow)], indirect=True)
def test_the_loop_of_100_hz_flies_and_has_a_static_footprint(folder: Path) -> None:
    assert list(ran(folder, EXAMPLE, SOURCE))[:2] == ["speed", "alpha"]
    text, data, bss, asked = footprint(folder, SOURCE)
    assert asked <= {
        *("sin", "cos", "atan2", "asin", "sqrt", "pow", "exp", "fmin", "fmax", "sincos", "__stack_chk_fail"),
        "_GLOBAL_OFFSET_TABLE_",
    }
    assert text < 64_000
    assert (data, bss) <= (512, 0)


@pytest.mark.parametrize("name", ["navion.py:NAVION", "f16.py:F16"])
def test_another_aircraft_is_ours_too_and_flies(name: str, tmp_path: Path) -> None:
    """Tables, parameters or none, another number of states; the rates of both at random states."""
    model = load_model(str(EXAMPLES / name))
    point = find_operating_point(model, usual_condition(model))
    linear, gain = linearize(model, point), np.zeros((len(model.inputs), len(model.linear)))
    written(tmp_path, c_model_texts(model, linear, gain, "here"), SOURCE)
    random, dx = np.random.default_rng(5), np.empty(len(model.states))
    for _ in range(50):
        x, u = (
            np.array(at) + 0.1 * np.array([each.nominal for each in of.values()]) * random.uniform(-1, 1, len(of))
            for at, of in ((point.states, model.states), (point.inputs, model.inputs))
        )
        called(tmp_path, "hfa_rates", x, u, 0.0, dx)
        np.testing.assert_allclose(dx, model.at(x, u).f, rtol=1e-12, atol=1e-12)
    if model.name == "Navion":
        assert list(ran(tmp_path, EXAMPLE, SOURCE)) == list(model.states)


def test_an_operation_that_c_does_not_have_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(BadInputError, match="rates: the operation OP_ERF cannot be written as C"):
        c_function(ca.Function("f", [x], [ca.erf(x)]), "rates", ("x",), ("y",))
