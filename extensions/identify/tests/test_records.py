"""Records: units, separators, and faults that are refused."""

import json
import pickle
from pathlib import Path

import numpy as np
import pytest
from cli import hfa as run
from flown_records import AIRCRAFT, FREE, SENSORS, UAV, begun, record, true_value

import hfa
from hfa_identify import read_record

#: Times, s, angles of attack, rad, and speeds, m/s, of a short record.
TIME = 0.02 * np.arange(12)
ALPHA = 0.1 + 0.01 * np.arange(12)
SPEED = 30.0 + np.arange(12)


def test_columns_of_a_record_are_converted(folder):
    """Columns in ms, degrees and kt are read in s, rad and m/s, and another column is a note."""
    columns = np.transpose([1e3 * TIME, np.degrees(ALPHA), SPEED / 0.514444444, SPEED])
    heads = "time [ms],alpha [°],speed (kt),fuel"
    rows = [heads, *(",".join(map(repr, row)) for row in columns.tolist())]
    Path("record.csv").write_text("\n".join(rows), encoding="utf-8")
    with pytest.warns(UserWarning, match="not used, as no state, .*: fuel"):
        read = read_record("record.csv", AIRCRAFT, dict.fromkeys(AIRCRAFT.inputs, 0.0))
    np.testing.assert_allclose(read.time, TIME, atol=1e-9)
    np.testing.assert_allclose(read.measured["alpha"], ALPHA, rtol=1e-6)
    np.testing.assert_allclose(read.measured["speed"], SPEED, rtol=1e-6)


#: Fault -> change of a column, and words of the refusal.
REFUSED = {
    "time repeated": (
        {"time": lambda t: np.where(t == t[7], t[6], t)},
        "row 8: time does not increase",
    ),
    "no time": ({"time": None}, "no column time"),
    "gap of an input": (
        {"elevator": lambda e: np.where(e == e.max(), np.nan, e)},
        "row 14: elevator has no finite number",
    ),
    "no input": ({"elevator": None}, "no column elevator"),
    "infinite": (
        {"alpha": lambda a: np.where(a == a.max(), np.inf, a)},
        "alpha has no finite number",
    ),
    "too short": ({"alpha": lambda a: a[:-1]}, "alpha has 199 samples"),
    "empty": ({"alpha": lambda a: np.full_like(a, np.nan)}, "alpha has 0 finite values"),
    "no quantity": (dict.fromkeys(SENSORS), "no column of a measured state or output"),
    "unknown": (
        {"alpha": None, "aplha": lambda _: record()["alpha"]},
        "unknown column 'aplha'; did you mean alpha",
    ),
}


@pytest.mark.parametrize("fault", REFUSED)
def test_a_faulty_record_is_refused(fault):
    """A record with one fault of `REFUSED` is refused: the message names record, column and fault."""
    columns = record()
    changes, message = REFUSED[fault]
    for name, change in changes.items():
        given = columns.pop(name, None)
        if change is not None:
            columns[name] = change(given)
    with pytest.raises(hfa.BadInputError, match=f"^record 1.* {message}"):
        hfa.identify(begun(1.5), columns, FREE)


def test_wrong_arguments_are_refused():
    """Unknown parameters, no records, no parameters, and one both free and given are refused."""
    for records, free, named in (
        (record(), ["Cm_p"], "no parameter 'Cm_p'"),
        (record(), ["Cx_*"], "no free parameter of .* matches 'Cx_"),
        ([], FREE, "no record;"),
        (record(), (), "free contains no list"),
    ):
        with pytest.raises(hfa.BadInputError, match=named):
            hfa.identify(begun(1.2), records, free)
    with pytest.raises(hfa.BadInputError, match="'elevater'; did you mean elevator"):
        hfa.identify(begun(1.2), record(), FREE, hold={"elevater": 0.0})
    with pytest.raises(hfa.BadInputError, match="inputs are 'step'; did you mean steps"):
        hfa.identify(begun(1.2), record(), FREE, inputs="step")
    with pytest.raises(hfa.BadInputError, match="both free and given"):
        hfa.identify(begun(1.2), record(), FREE, given=["Cm_q"])


def written(path, columns, degrees):
    """Write columns to a CSV file.

    degrees: column -> unit in degrees, to which the column is converted from radians
    """
    units = {"time": "s", **{name: s.unit for name, s in AIRCRAFT.signals.items()}} | degrees
    heads = [f"{name} [{units[name]}]" for name in columns]
    table = np.column_stack(
        [np.degrees(values) if name in degrees else values for name, values in columns.items()]
    )
    rows = [",".join(heads), *(",".join(map(repr, row)) for row in table.tolist())]
    Path(path).write_text("\n".join(rows))


FLOWN = AIRCRAFT.with_parameters(CD_0=0.05)
DEGREES = {"alpha": "deg", "elevator": "deg", "pitch_rate": "deg/s"}


@pytest.fixture
def words(folder):
    """Write data/uav.toml and its record flight.csv with CD_0 = 0.05; return the options for its Cm_q."""
    Path("data").mkdir()
    Path("data/uav.toml").write_text(Path(UAV).read_text())
    written("flight.csv", record(model=FLOWN), DEGREES)
    return ("--aircraft", "data/uav.toml", "--free", "Cm_q", "--given", "CD_0=0.05")


def test_the_command_gives_the_estimate_of_python(words):
    """The band of `hfa identify` contains the true value. With --inputs steps the estimate is another
    one, that of `hfa.identify(..., inputs="steps")`.
    """
    linear, stepped, chosen = (
        json.loads(run("identify", "flight.csv", *words, *more, "--json").out)["parameters"]["Cm_q"]
        for more in (("--inputs", "linear"), ("--inputs", "steps"), ())
    )
    assert linear["low"] < true_value("Cm_q") < linear["high"]
    model = hfa.load_model("data/uav.toml")
    given = {"CD_0": 0.05}
    found = hfa.identify(model, "flight.csv", ["Cm_q"], given=given, inputs="steps")["Cm_q"]
    assert stepped["value"] == found.value != linear["value"] == chosen["value"]


def test_the_command_writes_an_aircraft(words):
    """The file that `hfa identify` writes contains the estimates and the values of --given. It names the
    aircraft relative to itself, so that both can be moved, and is refused once the aircraft's file has
    changed.
    """
    Path("results").mkdir()
    done = run("identify", "flight.csv", *words, "-o", "results/found.toml", "--json")
    assert done.code == 0, done.out + done.err
    Path("elsewhere").mkdir()
    for name in ("data", "results"):
        Path(name).rename(Path("elsewhere", name))
    found = hfa.load_model("elsewhere/results/found.toml")
    assert found.parameters["CD_0"].start == 0.05
    estimate = json.loads(done.out)["parameters"]["Cm_q"]["value"]
    assert found.parameters["Cm_q"].start == pytest.approx(estimate)
    np.testing.assert_array_equal(pickle.loads(pickle.dumps(found)).p, found.p)
    moved = Path("elsewhere/data/uav.toml")
    moved.write_text(moved.read_text() + "\n# changed")
    with pytest.raises(hfa.BadInputError, match="SHA-256"):
        hfa.load_model("elsewhere/results/found.toml")


def test_the_command_refuses_in_one_line(folder):
    """A held quantity of another name is refused in one line, with exit code 2, and no file."""
    Path("record.csv").write_text("time,alpha\n0,1")
    options = ("--aircraft", UAV, "--free", "Cm_q", "--hold", "elevater=0")
    done = run("identify", "record.csv", *options, "-o", "found.toml")
    assert (done.code, Path("found.toml").exists()) == (2, False)
    (line,) = done.err.strip().splitlines()
    assert "'elevater'" in line


def test_a_file_of_a_flight_is_a_record(folder):
    """The text and the arrays that `hfa fly -o` writes have the same times, inputs and states, which
    the aircraft explains, also those that are 0 up to rounding.
    """
    words = ("fly", "--aircraft", UAV, "--initial", "alpha=2", "--duration", "2", "-o")
    reads = []
    for file in ("flown.csv", "flown.npz"):
        assert run(*words, file).code == 0
        read = read_record(file, AIRCRAFT, {})
        reads.append(np.hstack([read.time[:, None], read.inputs, read.table([*AIRCRAFT.states])]))
    np.testing.assert_allclose(*reads, rtol=1e-9, atol=1e-12)
    assert hfa.identify(AIRCRAFT, "flown.csv", ["Cm_q"]).ok
