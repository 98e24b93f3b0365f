"""TOML files that name another aircraft and new values of its parameters."""

import shutil
from pathlib import Path

import pytest
from cli import assert_refused, hfa, refused

import hfa as tool

EXAMPLES = Path(__file__).parents[3] / "examples"
PYTHON = """
import pathlib
from hfa import Model, Signal

pathlib.Path({executed!r}).write_text("executed")
CAR = Model(
    name="car",
    states={{"v": Signal(nominal=1.0, start=1.0)}},
    inputs={{"thrust": Signal(nominal=1.0)}},
    parameters={{"drag": Signal(start=1.0)}},
    equations=lambda x, u, p, w: ({{"v": u.thrust - p.drag * x.v}}, {{}}),
    trim={{"v": 1.0}},
)
"""


def alpha(path):
    """Return the angle of attack, rad, of the trim of an aircraft file."""
    return tool.trim(tool.load_model(str(path)))["alpha"]


@pytest.fixture
def folders(tmp_path, monkeypatch):
    """Two folders with different aircraft of the same name; the one without `here` is current."""
    here, other = tmp_path / "here", tmp_path / "other"
    for folder in (here, other):
        folder.mkdir()
    shutil.copy(EXAMPLES / "uav.toml", here / "uav.toml")
    less_lift = (EXAMPLES / "uav.toml").read_text().replace("CL_0 = 0.28", "CL_0 = 0.10")
    (other / "uav.toml").write_text(less_lift)
    monkeypatch.chdir(other)
    return here


def test_a_changed_aircraft_is_refused(folders):
    """A parameter file that states the SHA-256 of uav.toml is read in the folder of this file, and refused
    beside another file with this name.
    """
    digest = tool.load_model(str(folders / "uav.toml")).source.digest
    text = f'aircraft = "uav.toml"\nsha256 = "{digest}"\n[parameters]\nCL_alpha = 4.0\n'
    (folders / "found.toml").write_text(text)
    Path("found.toml").write_text(text)
    alpha(folders / "found.toml")  # of a trim, without an error
    assert_refused(hfa("trim", "--aircraft", "found.toml"), 2, "found.toml", "SHA-256", "sha256")


def test_files_that_name_each_other_are_refused(folders):
    """Parameter files that name each other as the aircraft, or a long chain of them, are refused in one line.
    A short chain that ends at a table is read.
    """
    (folders / "one.toml").write_text('aircraft = "../here/two.toml"\n')
    (folders / "two.toml").write_text('aircraft = "one.toml"\n')
    (folders / "self.toml").write_text('aircraft = "self.toml"\n')
    for number in range(500):
        (folders / f"{number}.toml").write_text(f'aircraft = "{number + 1}.toml"\n')
    for name in ("one.toml", "two.toml", "self.toml", "0.toml"):
        assert_refused(hfa("trim", "--aircraft", str(folders / name)), 2, "name each other", name)
    (folders / "two.toml").write_text('aircraft = "uav.toml"\n[parameters]\nCL_0 = 0.10\n')
    assert alpha(folders / "one.toml") == pytest.approx(alpha("uav.toml"), abs=1e-9)


@pytest.mark.parametrize(
    ("entries", "message"),
    [
        ("colour = 1", "unknown entry colour"),
        ("sha256 = 5", "sha256 is 5"),
        ("[parameters]\nmass = nan", "parameters.mass is nan"),
        ("[parameters]\nmass = -1.0", "mass is -1 kg; give at least 0 kg"),
        ("[parameters]\nmasss = 1.0", "has no parameter 'masss'; did you mean mass?"),
        ("[bands]\nmasss = [1.0, 2.0]", "unknown parameter"),
        ("[bands]\nmass = [1.0, 2.0]", "give [low, high] around its value 13.5"),
        ("[bands]\nmass = [20.0, 10.0]", "give [low, high] around"),
        ("[bands]\nmass = [nan, 20.0]", "bands.mass[0] is nan"),
    ],
)
def test_a_wrong_entry_is_refused(folders, entries, message):
    """Each wrong entry of a file of parameters is named in one line."""
    (folders / "wrong.toml").write_text(f'aircraft = "uav.toml"\n{entries}\n')
    files = str(folders / "uav.toml"), str(folders / "wrong.toml")
    assert message in refused(tool.load_model, *files)


@pytest.fixture(params=[("car.py:CAR", "car.py"), ("car_module:CAR", "car_module.py")])
def naming_python(request, folders, monkeypatch):
    """A TOML that names an aircraft in Python, and the file that exists if this code was executed."""
    named, file = request.param
    monkeypatch.syspath_prepend(str(folders))
    executed = folders / "executed"
    (folders / file).write_text(PYTHON.format(executed=str(executed)))
    parameters = folders / "found.toml"
    parameters.write_text(f'aircraft = "{named}"\n[parameters]\ndrag = 3.0\n')
    return parameters, executed


def test_a_data_file_executes_no_python(naming_python):
    """A TOML that names Python code is refused, and the code is not executed."""
    parameters, executed = naming_python
    result = hfa("trim", "--aircraft", str(parameters))
    assert_refused(result, 2, "--parameters", str(parameters))
    assert not executed.exists()
