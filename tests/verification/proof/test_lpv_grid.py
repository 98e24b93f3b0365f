"""A grid of linear models with a proved interpolation error, in SciPy's files and in C."""

from __future__ import annotations

import ctypes
import json
import shutil
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from known_models import exact_gain, model_at
from proof_cases import ORIGIN, family, forge

from hfa_model.vectors import INPUT_SCALES
from hfa_support import NoSolutionError
from verification import check_certificate, coarsest_grid
from verification.checker.checker import Rejected
from verification.proof.lpv_grid import LpvGrid, c_source, certify, lpv_report
from verification.proof.proof_report import checked_report

WITHIN = 4.9e-4


@pytest.fixture(scope="module")
def grid() -> LpvGrid:
    return coarsest_grid(family(), 14.0, 14.5, WITHIN)


def between(grid: LpvGrid, degrees: float) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    k = int(np.clip(np.searchsorted(grid.places, degrees, side="right") - 1, 0, len(grid.A) - 2))
    share = (degrees - grid.places[k]) / (grid.places[k + 1] - grid.places[k])
    return tuple(each[k] + share * (each[k + 1] - each[k]) for each in (grid.A, grid.B, grid.K))  # type: ignore[return-value]


def test_the_error_stays_below_its_bound_and_not_far(grid: LpvGrid) -> None:
    assert max(grid.error.values()) <= WITHIN
    errors, gains, trims = [], [], []
    for angle in np.linspace(14.0, 14.5, 17):
        model, (A, B, K) = model_at(float(angle)), between(grid, float(angle))
        gain = exact_gain(float(angle))
        gains.append(np.linalg.norm(K - gain) / np.linalg.norm(gain))
        u = [np.interp(angle, grid.places, column) for column in grid.inputs.T]
        trims.append(np.linalg.norm((np.array(u) - model.input_offsets) / INPUT_SCALES))
        errors.append(np.linalg.norm(A - model.A) / np.linalg.norm(model.A))
        assert np.linalg.norm(B - model.B) / np.linalg.norm(model.B) <= grid.error["B"]
    assert 0.5 * grid.error["A"] < max(errors) <= grid.error["A"]
    assert 0.4 * grid.error["K"] < max(gains) <= grid.error["K"]
    assert 0.51 * grid.error["inputs"] < max(trims) <= grid.error["inputs"]


def test_a_tolerance_that_is_too_small_is_said() -> None:
    with pytest.raises(NoSolutionError, match="no grid is proved within 1e-09"):
        coarsest_grid(family(), 14.0, 14.001, 1e-9)


def test_the_report_holds_the_matrices(grid: LpvGrid) -> None:
    report = lpv_report(grid, WITHIN)
    assert report.title.startswith(f"Proved: {len(grid.A)} models from 14 to 14.5 deg")
    assert np.array_equal(report.data["A"], grid.A)
    assert report.records is not None
    units = {row[1:4]: row[5] for row in report.records.rows}
    assert (units["A", "speed", "pitch_rate"], units["K", "throttle", "speed"]) == ("(ft/s^2)/(rad/s)", "(1)/(ft/s)")


@pytest.mark.skipif(shutil.which("gcc") is None, reason="no C compiler")
def test_the_c_function_interpolates(grid: LpvGrid, tmp_path: Path) -> None:
    source, library = tmp_path / "lpv.c", tmp_path / "lpv.so"
    source.write_text(c_source(grid, "by a test */ of this"))
    flags = ["-std=c99", "-Wall", "-Wextra", "-Werror", "-shared", "-fPIC"]
    subprocess.run(["gcc", *flags, str(source), "-o", str(library)], check=True)
    function = ctypes.CDLL(str(library)).hfa_lpv
    A, B, U0, K = (np.zeros(size) for size in (36, 30, 5, 30))
    pointers = [each.ctypes.data_as(ctypes.POINTER(ctypes.c_double)) for each in (A, B, U0, K)]
    for angle in (14.0, 14.3, 14.499, 14.5):
        assert function(ctypes.c_double(angle), *pointers) == 0
        expected_A, expected_B, expected_K = between(grid, angle)
        np.testing.assert_allclose(K.reshape(5, 6), expected_K, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(A.reshape(6, 6), expected_A, rtol=1e-13, atol=1e-13)
        np.testing.assert_allclose(B.reshape(6, 5), expected_B, rtol=1e-13, atol=1e-13)
    for angle in (13.999, 14.501, np.nan):
        assert function(ctypes.c_double(angle), *pointers) == 1


def test_a_grid_is_verified_and_a_better_one_is_not(grid: LpvGrid, tmp_path: Path) -> None:
    path = tmp_path / "certificate.json"
    certify(grid, path, ORIGIN)
    data = checked_report(check_certificate(path)).data
    assert data["nodes"] == len(grid.A)
    stated = data["error"]
    assert all(stated[name] <= 1.01 * grid.error[name] for name in ("A", "B", "inputs"))
    assert stated["K"] <= max(stated.values()) <= WITHIN
    content = json.loads(path.read_text())
    for change in (_smaller_error, _other_gain, _missing_cell):
        forged = json.loads(path.read_text())
        change(forged)
        forge(path, forged)
        with pytest.raises(Rejected):
            check_certificate(path)
        path.write_text(json.dumps(content))


def _smaller_error(content: dict[str, Any]) -> None:
    content["statement"]["distances"]["A"][1] /= 4.0


def _other_gain(content: dict[str, Any]) -> None:
    content["statement"]["table"]["K"][0] = (1.2 * np.array(content["statement"]["table"]["K"][0])).tolist()


def _missing_cell(content: dict[str, Any]) -> None:
    content["boxes"]["cells"].pop(3)
