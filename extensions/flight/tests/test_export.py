"""`hfa export`: the files that it writes, and refused requests."""

from __future__ import annotations

import json
import zipfile
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from controllers import integrating_controller

from hfa_aircraft.model import Model
from hfa_flight import save_controller
from hfa_flight.export import fmu
from hfa_support.native.machine_code import c_compiler


@pytest.fixture(autouse=True)
def _in_a_folder(folder: Path) -> None:
    """Run each test in a new empty folder."""


def constants(source: Path, name: str) -> np.ndarray:
    """Return the array `name` defined in a C file."""
    line = next(
        line
        for line in source.read_text("utf-8").splitlines()
        if line.startswith(f"const double {name}[")
    )
    return np.array(
        json.loads(line.partition(" = ")[2].rstrip(";").replace("{", "[").replace("}", "]"))
    )


def test_exported_c_files_contain_the_commands_numbers(tmp_path: Path) -> None:
    """Trim, A, B and K in the C files equal those of `hfa linearize` and `hfa solve`."""
    result = hfa(
        "export", "-o", str(tmp_path / "c"), "--dihedral", "10", "--delta", "300", "--json"
    )
    assert (result.code, result.err) == (0, "")
    data = json.loads(result.out)
    assert [Path(each["file"]).name for each in data["files"]] == [
        "hfa_aircraft.h",
        "hfa_aircraft.c",
        "loop_100hz.c",
    ]
    source = tmp_path / "c" / "hfa_aircraft.c"
    model = json.loads(hfa("linearize", "--dihedral", "10", "--json").out)
    solved = json.loads(hfa("solve", "--dihedral", "10", "--delta", "300", "--json").out)
    for name, known in (("hfa_A", model["A"]), ("hfa_B", model["B"]), ("hfa_K", solved["K"])):
        np.testing.assert_array_equal(constants(source, name), known)
    np.testing.assert_array_equal(
        constants(source, "hfa_x0"), list(model["operating_point"]["states"].values())
    )
    text = source.read_text("utf-8")
    assert "parameters identified (" in text
    assert f"hfa export -o {tmp_path / 'c'} --dihedral 10" in text
    assert text.count("2026-09-21") == 1


@pytest.mark.skipif(c_compiler() is None, reason="there is no C compiler")
def test_an_fmu_contains_its_origin(tmp_path: Path) -> None:
    """An FMU contains the command line and the trim condition from which it was exported."""
    path = tmp_path / "aircraft.fmu"
    result = hfa("export", "-o", str(path), "--dihedral", "16", "--law", "exact")
    assert result.code == 0
    assert result.out.startswith("Exported: 1 file\n")
    assert "16 deg is beyond the paper's range" in result.err
    with zipfile.ZipFile(path) as archive:
        origin = json.loads(archive.read("resources/provenance.json"))
        described = archive.read("modelDescription.xml").decode()
    assert origin["condition"]["imposed"]["dihedral"] == pytest.approx(np.radians(16))
    assert 'name="reference_speed"' in described
    assert f"hfa export -o {path} --dihedral 16" in described


@pytest.mark.skipif(c_compiler() is None, reason="there is no C compiler")
def test_a_controller_is_exported_to_c_and_fmu(tmp_path: Path, published_aircraft: Model) -> None:
    """A controller with actuators is exported as an FMU and as C files.

    The C files name the controller file. Wrong options are refused, and no file is written.
    """
    save_controller(tmp_path / "servo.npz", integrating_controller(published_aircraft))
    words = (
        "--controller",
        str(tmp_path / "servo.npz"),
        "--actuators",
        "0.5:60",
        "--dihedral",
        "10",
    )
    names = []
    for place in ("a.fmu", "c"):
        result = hfa("export", "-o", str(tmp_path / place), *words, "--json")
        assert (result.code, result.err) == (0, "")
        names += [Path(each["file"]).name for each in json.loads(result.out)["files"]]
    c = [
        "hfa_aircraft.h",
        "hfa_aircraft.c",
        "hfa_controller.h",
        "hfa_controller.c",
        "controller_100hz.c",
    ]
    assert names == ["a.fmu", *c]
    assert f"--controller {tmp_path / 'servo.npz'}" in (
        tmp_path / "c" / "hfa_controller.c"
    ).read_text("utf-8")
    assert not constants(tmp_path / "c" / "hfa_aircraft.c", "hfa_K").any()
    with zipfile.ZipFile(tmp_path / "a.fmu") as archive:
        assert 'name="command_dihedral"' in archive.read("modelDescription.xml").decode()
    before = sorted(tmp_path.rglob("*"))
    for more, said in (
        (("--actuators", "0.5:60", "--dihedral", "25"), "controller small covers dihedral 5 to 20"),
        (("--law", "exact", "--actuators", "0.5:60"), "--law has no effect with --controller"),
        (("--dihedral", "10"), "requires actuators in an FMU; add --actuators LAG:RATE"),
    ):
        assert_refused(
            hfa(
                "export",
                "-o",
                str(tmp_path / "a.fmu"),
                "--controller",
                str(tmp_path / "servo.npz"),
                *more,
            ),
            2,
            said,
        )
    assert sorted(tmp_path.rglob("*")) == before


def test_an_fmu_needs_a_compiler(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Without a C compiler, the export of an FMU fails with exit code 1 and writes no file."""
    # The compiler is searched only once in a process.
    monkeypatch.setattr(fmu, "c_compiler", lambda: None)
    assert_refused(
        hfa("export", "-o", str(tmp_path / "a.fmu")), 1, "requires a C compiler", "install gcc"
    )
    assert list(tmp_path.iterdir()) == []
