"""The C files: compiled without a warning, and the same numbers as ours."""

from __future__ import annotations

import ctypes
from pathlib import Path

import casadi as ca
import numpy as np
import pytest
from c_files import called, compiled, footprint, needs_gcc, ran
from known_models import model_at

from controller.export.c_model import EXAMPLE, HEADER, SOURCE, CModel, c_model_texts, comment_lines
from hfa_model import STATES, Aircraft
from hfa_model.dynamics import state_rates, symbols
from hfa_model.vectors import INPUT_SCALES, STATE_SCALES
from hfa_support import BadInputError
from hfa_support.files import write_texts
from hfa_support.native.c_code import c_function
from trim import OperatingPoint, trim_points

pytestmark = needs_gcc
POINTS = 1000


@pytest.fixture(scope="module")
def folder(aircraft: Aircraft, tmp_path_factory: pytest.TempPathFactory) -> Path:
    made = tmp_path_factory.mktemp("c")
    gain = np.arange(30.0).reshape(5, 6) / 100
    write_texts(made, c_model_texts(CModel(aircraft, model_at(15.0, aircraft.variant.name), gain, "from */ here")))
    compiled(made, "-shared", "-fPIC", SOURCE, "-o", "hfa.so")
    return made


@pytest.fixture(scope="module")
def library(folder: Path) -> ctypes.CDLL:
    return ctypes.CDLL(str(folder / "hfa.so"))


def states_and_inputs(point: OperatingPoint) -> tuple[np.ndarray, np.ndarray]:
    random = np.random.default_rng(5)
    x = np.array(point.states) + 0.5 * np.array(STATE_SCALES) * random.uniform(-1, 1, (POINTS, 7))
    return x, np.array(point.inputs) + 0.5 * np.array(INPUT_SCALES) * random.uniform(-1, 1, (POINTS, 5))


def test_rates_and_jacobians_are_ours(library: ctypes.CDLL, aircraft: Aircraft, point: OperatingPoint) -> None:
    (x, u, p), w = symbols(), ca.SX.sym("w")
    ours = ca.Function("ours", [x, u, p, w], [state_rates(x, u, p, aircraft.variant, w)])
    dx, A, B = np.empty(7), np.empty((7, 7)), np.empty((7, 5))
    for row, (state, control) in enumerate(zip(*states_and_inputs(point), strict=True)):
        updraft = float(row % 5 - 2)
        called(library, "hfa_rates", state, control, updraft, dx)
        known = np.array(ours(state, control, np.array(aircraft.parameters), updraft)).ravel()
        np.testing.assert_allclose(dx, known, rtol=1e-14, atol=0)
        called(library, "hfa_linearize", state, control, A, B)
        _, known_A, known_B = aircraft.jacobians(state, control)
        for found, known in ((A, known_A), (B, known_B)):
            assert np.linalg.norm(found - known) <= 1e-14 * np.linalg.norm(known)


def test_level_flights_are_ours(library: ctypes.CDLL, aircraft: Aircraft) -> None:
    dihedral = np.radians(np.linspace(0, 20, POINTS))
    known = trim_points(aircraft, ("dihedral",), dihedral[:, None])
    x, u, A, B = np.empty(7), np.empty(5), np.empty((7, 7)), np.empty((7, 5))
    for row, angle in enumerate(dihedral.tolist()):
        at = (angle, 68.0, 40000.0, np.radians(2.8), 0.0)
        assert called(library, "hfa_level_flight", *at, x, u, A, B) == 0
        for found, table in ((x, known.states), (u, known.inputs), (A, known.A), (B, known.B)):
            assert np.linalg.norm(found - table[row]) <= 1e-14 * np.linalg.norm(table[row])


def test_a_climb_balances_though_its_altitude_changes(library: ctypes.CDLL, aircraft: Aircraft) -> None:
    x, u, A, B = np.empty(7), np.empty(5), np.empty((7, 7)), np.empty((7, 5))
    assert called(library, "hfa_level_flight", 0.2, 68.0, 40000.0, 0.0489, 0.02, x, u, A, B) == 0
    rates = np.array(aircraft.rates(x, u))
    assert rates[STATES.index("altitude")] == pytest.approx(68.0 * np.sin(0.02))
    assert np.abs(np.delete(rates, STATES.index("altitude"))).max() < 1e-8


@pytest.mark.parametrize(
    ("changed", "code"), [({"alpha": 0.12}, 1), ({"altitude": 66000.0}, 1), ({"speed": float("nan")}, 2)]
)
def test_what_is_no_level_flight_is_said(library: ctypes.CDLL, changed: dict[str, float], code: int) -> None:
    condition = {"dihedral": 0.2, "speed": 68.0, "altitude": 40000.0, "alpha": 0.0489, "gamma": 0.0} | changed
    arrays = np.empty(7), np.empty(5), np.empty((7, 7)), np.empty((7, 5))
    assert called(library, "hfa_level_flight", *condition.values(), *arrays) == code


def test_the_policy_and_the_constants(library: ctypes.CDLL, folder: Path, aircraft: Aircraft) -> None:
    model, gain = model_at(15.0, aircraft.variant.name), np.arange(30.0).reshape(5, 6) / 100
    point = model.point
    x, u = np.array(point.states) + np.arange(7.0) / 10, np.empty(5)
    called(library, "hfa_policy", x, u)
    np.testing.assert_allclose(u, np.array(point.inputs) - gain @ (np.arange(7.0) / 10)[[0, 1, 3, 4, 5, 6]], rtol=1e-14)
    stored = (ctypes.c_double * 36).in_dll(library, "hfa_A")
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


def test_an_operation_that_c_does_not_have_is_named() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(BadInputError, match="rates: the operation OP_ERF cannot be written as C"):
        c_function(ca.Function("f", [x], [ca.erf(x)]), "rates", ("x",), ("y",))
    assert comment_lines("a */\nb") == "a * /\n   b"
