"""The linear models of a file of conditions: one object, one file, the models of single rows."""

import json
from pathlib import Path

import control
import numpy as np
import pandas as pd
import pytest
from cli import answer, assert_refused, hfa as command
from project import ROOT
from scipy.io import loadmat

import hfa

#: Rows that hold and free different variables, of other masses; a stall, and a row without a trim.
CONDITIONS = """name,speed,KCAS,altitude,gamma,load_factor,thrust,mass,free,limit
cruise,35,,100,0,,,,,
at 60 KCAS,,60,1000,0,,,,,
turn,35,,100,,1.3,,,turn_rate,
glide,25,,100,,,0,20,gamma,elevator=-15:15
stall,18.5,,100,,,,,,
weak,35,,100,,,,,,thrust=0:5
"""
NAMES = ("cruise", "at 60 KCAS", "turn", "glide", "stall", "weak")
MATRICES = "ABCDE"


@pytest.fixture(scope="module")
def file(tmp_path_factory):
    """Return the path of the file with `CONDITIONS`."""
    path = tmp_path_factory.mktemp("models") / "book.csv"
    path.write_text(CONDITIONS, "utf-8")
    return str(path)


@pytest.fixture(scope="module")
def words(uav, file):
    """Return the options of the aircraft and its conditions."""
    return ("--aircraft", uav, "--conditions", file)


@pytest.fixture(scope="module")
def book(uav, file):
    """Return the trims and linear models of all conditions, by Python."""
    return hfa.conditions(hfa.load_model(uav), file)


def written(words, path):
    """Write the models of all conditions to a path, and return it. One has no trim: exit code 1."""
    run = command("linearize", *words, "-q", "-o", str(path))
    assert (run.code, run.err) == (1, "hfa: 1 of 6 conditions have no trim\n")
    assert run.out.startswith(
        "Aerosonde: linear models of 5 of 6 conditions, 1 stalled, 1 without a trim\n"
    )
    return path


def arrays_in(path):
    with np.load(path) as file:
        return dict(file)


def test_each_file_has_the_models_of_single_rows_to_the_bit(words, book, tmp_path):
    """The file of all conditions in each format (JSON, MATLAB's structs, NumPy's arrays) has the
    matrices A to E that `hfa linearize --row NAME` has.
    """
    as_json = json.loads(written(words, tmp_path / "a.json").read_text("utf-8"))
    structs = loadmat(written(words, tmp_path / "a.mat"))["models"]
    arrays = arrays_in(written(words, tmp_path / "a.npz"))
    assert structs.shape == (1, len(NAMES))
    assert [model["name"] for model in as_json["models"]] == [*NAMES]
    assert tuple(arrays["names"]) == NAMES
    for row, name in enumerate(NAMES[:-1]):  # the last, "weak", has no trim
        single = answer("linearize", *words, "--row", name)
        assert single["states"] == as_json["states"] == arrays["states"].tolist()
        for matrix in MATRICES:
            given = np.array(single.get(matrix, np.zeros((8, 0))))  # no disturbances
            for found in (
                np.reshape(as_json["models"][row][matrix], given.shape),
                structs[0, row][matrix],
                arrays[matrix][row],
                getattr(book, matrix)[row],
            ):
                assert np.array_equal(found, given), (name, matrix)
        # The structs have a name for each eigenvalue, and an oscillation has two.
        named = dict.fromkeys(str(name[0]) for name in structs[0, row]["mode_names"][0])
        assert [*named] == [mode["name"] for mode in single["modes"]]
        poles = control.ss(*(arrays[matrix][row] for matrix in "ABCD")).poles()
        assert sorted(poles.real) == pytest.approx(sorted(arrays["eigenvalues"][row].real))


def test_a_condition_without_a_trim_has_nan_and_its_reason(words, book, tmp_path):
    """The arrays have the status of each condition, and nan and a reason for one without a trim
    ("weak", with at most 5 N of thrust). In Python, its point is refused with the reason.
    """
    arrays = arrays_in(written(words, tmp_path / "a.npz"))
    assert arrays["status"].tolist() == [*["trimmed"] * 4, "stalled", "no trim"]
    assert [bool(reason) for reason in arrays["reason"]] == [False] * 5 + [True]
    for matrix in "ABCD":
        assert np.isnan(arrays[matrix][-1]).all()
        assert np.isfinite(arrays[matrix][:-1]).all()
    models = json.loads(written(words, tmp_path / "a.json").read_text("utf-8"))["models"]
    assert models[-1]["A"][0][0] is None
    assert "thrust at maximum 5 N" in models[-1]["reason"]
    with pytest.raises(hfa.NoSolutionError, match=r"weak: no trim: .*thrust at maximum"):
        book["weak"]
    with pytest.raises(hfa.BadInputError, match="unknown condition 'cruse'"):
        book["cruse"]
    for typed, code, said in (("9e9,", 2, "give a value between"), ("35,thrust=0:5", 1, "no trim")):
        (tmp_path / "one.csv").write_text(f"name,speed,limit\nonly,{typed}\n", "utf-8")
        run = command("linearize", *words[:2], "--conditions", str(tmp_path / "one.csv"))
        assert (run.code, said in run.out + run.err) == (code, True)


def test_an_entry_of_the_book_is_the_operating_point_of_its_row(book):
    """By name, the book has operating points, whose linear models are its own; they have what the
    rows of `CONDITIONS` hold: "glide" no thrust and a mass of 20 kg, others the 13.5 kg as loaded.
    """
    assert tuple(book) == NAMES
    for row, name in enumerate(NAMES[:-1]):  # the last has no trim
        point = book[name]
        assert point.linearize() == book[row].linearize()
        assert np.array_equal(point.linearize().A, book.A[row])
    assert book["glide"]["thrust"] == 0.0
    assert book["glide"].model.parameters["mass"].start == 20.0
    _, parameters = book.arrays["trim_parameters"]
    assert parameters[:-1, [*book.model.parameters].index("mass")].tolist() == [
        13.5,
        13.5,
        13.5,
        20.0,
        13.5,
    ]


def test_the_level_of_a_mode_is_the_worst_of_its_figures_on_the_sheet(book):
    """The level of each mode is the worst of the levels that the sheet of the trim gives to figures
    of this mode; for the short period, the control anticipation parameter (CAP) counts, too.
    """
    for row, name in enumerate(NAMES[:-1]):
        sheet = book[name].sheet
        for mode in book.modes[row]:
            family = mode.name.partition(" (")[0]
            levels = [each.level for each in sheet if each.name.startswith(family)]
            if family == "short period" and "CAP" in sheet:
                levels.append(sheet["CAP"].level)
            worst = max((level for level in levels if level), default=None)
            assert book.levels[row][mode.name] == worst
            (_, named), (_, levels) = book.arrays["mode_names"], book.arrays["mode_levels"]
            stored = levels[row][named[row] == mode.name]
            np.testing.assert_array_equal(stored, np.nan if worst is None else worst)


def test_tables_of_the_book_find_entries_by_names(book, tmp_path):
    """Book and pandas have the entry A(alpha, pitch_rate) by its names, and what "turn" holds. The CSV file is a file of conditions with the same models, nan without a trim."""
    entry = book.A["alpha", "pitch_rate"]
    frame = book.to_pandas()
    assert frame.loc["turn", "A(alpha, pitch_rate) [(rad/s)/(rad/s)]"] == entry[2]
    assert frame.loc["turn", "hold load_factor"] == 1.3
    book.save(tmp_path / "models.csv")
    again = hfa.conditions(book.model, tmp_path / "models.csv")
    np.testing.assert_array_equal(again.A, book.A)
    read = pd.read_csv(tmp_path / "models.csv", index_col="name")
    assert np.isnan(read.loc["weak", "alpha [deg]"])


def test_states_inputs_and_outputs_are_chosen_for_all_conditions(words, tmp_path):
    """--states, --inputs and --outputs select signals of all conditions, as of a single one."""
    chosen = ("--states", "alpha,pitch_rate", "--inputs", "elevator", "--outputs", "load_factor")
    command("linearize", *words, *chosen, "-q", "-o", str(tmp_path / "a.npz"))
    arrays = arrays_in(tmp_path / "a.npz")
    single = answer("linearize", *words, *chosen, "--row", "turn")
    assert arrays["C"].shape == (6, 1, 2)
    for matrix in "ABCD":
        np.testing.assert_array_equal(arrays[matrix][2], single[matrix])


def test_frequency_responses_require_a_single_condition(words):
    """--bode is refused without --row."""
    assert_refused(command("linearize", *words, "--bode"), 2, "--bode", "--row NAME")


@pytest.mark.parametrize("suffix", [".npz", ".json"])
def test_the_game_on_a_row_of_stored_models_is_that_at_its_condition(folder, suffix):
    """`solve --model FILE --row NAME` takes the plant of one row; without --row, the rows are named."""
    Path("rows.csv").write_text("name,dihedral\nfive,5\nten,10\n")
    command("linearize", "--conditions", "rows.csv", "-o", f"models{suffix}")
    words = ("solve", "--model", f"models{suffix}")
    assert_refused(command(*words), 2, "--row NAME: five, ten")
    assert_refused(command(*words, "--row", "six"), 2, "choose from five, ten")
    assert_refused(command("trim", "--aircraft", f"models{suffix}"), 2, "plants of 2 rows")
    found, there = (answer(*words, "--row", "ten")["P"], answer("solve", "--dihedral", "10")["P"])
    np.testing.assert_allclose(found, there, rtol=1e-9)


def test_a_document_has_all_matrices_of_each_condition(tmp_path):
    """A page of models.md for each trim has C of the chosen outputs, models.csv its entries too."""
    rows, outputs = tmp_path / "rows.csv", ("load_factor", "gamma")
    rows.write_text("name,speed [m/s]\ncruise,35\nslow,22\nno,10\n", "utf-8")
    book = hfa.conditions(hfa.load_model(f"{ROOT}/examples/uav.toml"), rows, outputs=outputs)
    book.save(tmp_path / "models.md")
    text = (tmp_path / "models.md").read_text("utf-8")
    slopes = book.C["load_factor", "alpha"]
    for number, name in enumerate(("cruise", "slow")):
        page = text[text.index(f"{number + 1} {name}: ") :]
        assert f"{slopes[number]:.4f}" in page
    assert "3 no: " not in text
    table = book.to_pandas()
    assert table["C(load_factor, alpha) [(1)/(rad)]"]["slow"] == slopes[1]
