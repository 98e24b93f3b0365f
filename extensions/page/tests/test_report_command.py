"""`hfa report`: one page, or a folder with page, pictures and numbers."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from cli import answer, assert_refused, hfa
from json_places import replaced
from project import ROOT

pytest.importorskip("hfa_flight")

from hfa import BadInputError, Model, Signal, load_model, trim
from hfa.main import BAD_INPUT, DONE, FAILED
from hfa_page.main_job import Position, flight_in_turbulence, values_about
from trim.point.condition import usual_condition


@pytest.fixture(autouse=True)
def _in_a_folder(folder):
    """Run each test in a new empty folder."""


FLIGHTS = ROOT / "studies" / "best_flights" / "results"
UAV = str(ROOT / "examples" / "uav.toml")


def page_of(path):
    """Return the page without the script of Plotly."""
    html = path.read_text("utf-8")
    longest = max(re.findall(r"<script[^>]*>.*?</script>", html, re.S), key=len)
    return html.replace(longest, "")


def test_the_page_states_the_reason_for_a_missing_flight_in_turbulence(monkeypatch):
    """In place of the flight, the page states why the trim is missing, or that the package of flights,
    hidden here, is not installed. The UAV stands for any aircraft.
    """
    condition = usual_condition(load_model(UAV))
    nowhere = flight_in_turbulence(Position(0.2, condition, reason="no trim at 11 deg"))
    assert "no trim at 11 deg" in nowhere.parts[0]
    monkeypatch.setitem(sys.modules, "hfa_flight.policies.filter", None)
    missing = flight_in_turbulence(Position(0.2, condition))
    assert "hfa_flight is not installed" in missing.parts[0]


def test_values_of_at_are_the_trims_of_these_values(folder):
    """With --at 35,30,100 and --sweep, the numbers are the trims, models, games and sweep of the commands
    that compute them alone, in the order of the speeds; the folder has page, pictures and numbers.

    At each position of the slider the page has the modes, A and the used share of the 60 N of thrust; at
    100 m/s, the reason why there is no trim. The page has the name of the aircraft, a warning, since no
    rigid body has inertias with Izz = 3, and nothing of the paper.
    """
    Path("uav.toml").write_text(Path(UAV).read_text("utf-8").replace("Izz = 1.759", "Izz = 3.0"))
    weights = ("--Q", ",".join("1" * 8), "--R", ",".join("1" * 4))
    words = ("--aircraft", "uav.toml", "--outputs", "load_factor")
    words += ("--at", "35,30,100", "--sweep", "29,30")
    result = hfa("report", *words, *weights, "-o", "pages", "--json")
    assert result.code == DONE
    data = json.loads(result.out)
    assert data == json.loads(Path("pages", "numbers.json").read_text("utf-8"))
    assert data["ok"]
    assert data["sweep"]["grid"]["speed"]["values"] == [29.0, 30.0, 35.0, 100.0]
    page = page_of(Path("pages", "report.html"))
    *trimmed, beyond = data["angles"]
    sections = re.findall(
        r'<section class="point" data-value="([^"]*)".*?>(.*?)</section>', page, re.S
    )
    shown = {at: "".join(text for each, text in sections if each == at) for at, _ in sections}
    assert [*shown] == ["29 m/s", "30 m/s", "35 m/s", "100 m/s"]
    drawn = re.findall(r'<script type="application/json" data-plot.*?>(.*?)</script>', page, re.S)
    shares, *loci = map(json.loads, drawn)
    for plot in (shares, *loci):
        changing = [[len(plot["data"]) - 1]] * len(shown)
        assert [frame["traces"] for frame in plot["frames"]] == changing
    for trace in (trace for plot in loci for trace in plot["data"][:-1]):
        for x, (_, size, damping) in zip(trace["x"][:-1], trace["customdata"][:-1], strict=True):
            assert damping * size == pytest.approx(-x, abs=1e-4)
    assert f"No trim: {beyond['reason']}" in shown["100 m/s"]
    for found, speed in zip(trimmed, (30.0, 35.0), strict=True):
        assert found["scheduled"] == {"speed": speed}
        held = ("--aircraft", "uav.toml", "--hold", f"speed={speed}")
        states = found["trim"]["operating_point"]["states"]
        assert states == pytest.approx(answer("trim", *held)["operating_point"]["states"], rel=1e-9)
        linear = answer("linearize", *held, "--outputs", "load_factor")
        for matrix in "ABCD":
            np.testing.assert_allclose(found["model"][matrix], linear[matrix], rtol=1e-6, atol=1e-9)
        for number in (linear["A"][0][1], *(mode["damping"] for mode in linear["modes"])):
            assert f">{number:.4f}<" in shown[f"{speed:g} m/s"]
        (share,) = shares["frames"][[*shown].index(f"{speed:g} m/s")]["data"]
        thrust = found["trim"]["operating_point"]["inputs"]["thrust"] / 0.6
        assert any(value == pytest.approx(thrust) for value in share["x"])
        solved = answer("solve", *held, *weights)
        np.testing.assert_allclose(found["solution"]["K"], solved["K"], rtol=1e-6, atol=1e-9)
        assert f"Speed {speed:g} m/s: model, game" in page
        assert re.search(f"solution of the game at {speed:g} m/s</th><td[^>]*>proved<", page)
    for section in ("Modes over speed", "Book", "Warnings"):
        assert f"<h2>{section}<" in page
    assert "no rigid body has these inertias" in page.partition("<h2>Warnings<")[2]
    assert "No condition has a trim" not in page
    assert "<title>Aerosonde (derivatives): trims" in page
    assert not any(word in page for word in ("printed", "dihedral", "Zhang"))
    assert {path.suffix for path in Path("pages").iterdir()} == {".html", ".json", ".png"}
    assert all(path.stat().st_size > 9999 for path in Path("pages").iterdir())


def test_a_page_of_listed_conditions_without_any_trim(folder):
    """At 100 m/s and at 8 m/s, a condition of book.csv, the UAV has no trim: the page says so, without
    pictures.
    """
    Path("book.csv").write_text("name,speed\nslow,8\n")
    words = ("--at", "100", "--sweep", "100", "--conditions", "book.csv", "-o", "page.html")
    result = hfa("report", "--aircraft", UAV, *words)
    assert (result.code, "Trimmed: 0 of 1" in result.out) == (FAILED, True)
    page = page_of(Path("page.html"))
    assert "No condition has a trim." in page
    assert "data-plot=" not in page


@pytest.mark.slow
def test_a_report_replaces_the_pictures_of_an_earlier_one(folder):
    """A report with other angles removes the pictures of the earlier report, which its numbers
    name, and no other file.
    """
    words = ("report", "-o", "pages", "--sweep", "5:15:10", "--dihedral")
    assert hfa(*words, "5").code == DONE
    Path("pages", "critic-7.png").write_bytes(b"of the user")
    assert hfa(*words, "15").code == DONE
    critics = {path.name for path in Path("pages").glob("critic-*.png")}
    assert critics == {"critic-15.png", "critic-7.png"}


@pytest.mark.slow
def test_the_folder_contains_page_pictures_and_numbers(folder):
    """The folder contains the page, pictures and numbers, which are printed too and equal those of
    `hfa linearize` and `hfa fly` with the page's noise. The page has verdict, matrices, the costs
    of stored flights and three pictures, and loads nothing from a network.
    """
    folder = folder / "new"
    line = "--dihedral 15 --json --outputs load_factor --sweep 10:20:5 -o new --flights"
    result = hfa("report", *line.split(), str(FLIGHTS))
    assert (result.code, result.err) == (DONE, "")
    names = {
        "report.html",
        "numbers.json",
        "regeneration.png",
        "root_locus.png",
        "trim.png",
        "critic-15.png",
        "turbulence.png",
    }
    assert {path.name for path in folder.iterdir()} == names
    text = (folder / "numbers.json").read_text("utf-8")
    data = json.loads(text, parse_constant=pytest.fail)
    assert json.loads(result.out) == data
    assert data["ok"]
    # Numbers, also by the commands that compute them alone.
    counts = [len(data["regeneration"]["cases"]), len(data["sweep"]["A"]), len(data["angles"])]
    assert counts == [2, 3, 1]
    linearized = json.loads(hfa("linearize", "--dihedral", "15", "--json").out)
    assert data["angles"][0]["model"]["A"] == linearized["A"]
    noise = ("speed=.3", "alpha=.17", "pitch=.11", "pitch_rate=.17", "dihedral=.11")
    sensors = [f"--noise={each}" for each in (*noise, "dihedral_rate=.17")]
    words = ("fly", "--dihedral", "15", "--filter", "--turbulence", "moderate:40000", *sensors)
    flown = json.loads(hfa(*words, "--json").out)
    assert data["in_turbulence"]["ok"] is flown["within_limits"] is True
    assert data["in_turbulence"]["rms_error"] == pytest.approx(flown["rms_error"], rel=1e-9)
    # The page: verdict, pictures in the file itself, no address but that of the paper, matrices, costs.
    html = page_of(folder / "report.html")
    assert 'are <strong class="good">regenerated</strong>' in html
    assert html.count('src="data:image/png;base64,') == html.count("<img ") == 3
    html = html.replace('<a href="https://doi.org/10.3390/electronics15173838">', "")
    assert not any(word in html for word in ("http://", "https://", "<link", 'src="/', "<pre"))
    assert data["provenance"]["parameter_hash"] in html
    assert '<tr><th scope="row">load_factor</th>' in html
    best = json.loads((FLIGHTS / "best_flights.json").read_text("utf-8"))["flights"][-1]["best"]
    assert f"{best['cost']:,.0f}" in html
    assert "for this page&#x27;s aircraft" in html
    assert "Costs of nonlinear flights from the paper" in html.partition("<details")[0]


@pytest.mark.slow
def test_pictures_of_the_documents_are_current():
    """The pictures of the documents equal those that `hfa report` draws."""
    from matplotlib.image import imread

    assert hfa("report", "-o", "pages", "--dihedral", "15").code == DONE

    folder = ROOT / "docs" / "pictures"
    drawn = ["regeneration.png", "root_locus.png"]
    # A browser and pdftoppm draw the page and the sheets.
    others = ["page.png", "sheet_html.png", "sheet_pdf.png"]
    others += ["book_cover.png", "book_matrix.png"]
    assert sorted(path.name for path in folder.glob("*.png")) == sorted([*drawn, *others])
    for name in drawn:
        one = imread(folder / name)
        other = imread(Path("pages", name))
        assert one.shape == other.shape
        # Other releases of the font library change the edges of some letters.
        assert np.mean(np.abs(one - other) > 0.1) < 0.005, "run `make pictures`"


@pytest.mark.slow
def test_an_angle_without_trim_is_reported_with_reason(tmp_path):
    """An angle without a trim is on the page with the reason, and the command fails: the HFA has no
    trim at 59 deg.
    """
    page = tmp_path / "page.html"
    result = hfa("report", "-o", str(page), "--dihedral", "59", "--sweep", "20,59")
    assert (result.code, result.err) == (FAILED, "")
    assert "Learned critics agree with the exact game solution: NO" in result.out
    html = page_of(page)
    assert (
        html.count("these rates do not balance: dihedral_rate") == 4
    )  # in the slider, the sweep, the flight in turbulence and the section on the angle
    assert re.search("solution of the game at 59 deg</th><td[^>]*>none<", html)


@pytest.mark.slow
def test_a_missing_plotly_is_refused_before_the_computation():
    """Without Plotly (hidden here), the page is refused in one line and not written."""
    program = "import sys; sys.modules['plotly.offline'] = None; import hfa.main; "
    program += "sys.exit(hfa.main.main(['report', '-o', 'page.html']))"
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert (done.returncode, done.stderr.count("\n")) == (BAD_INPUT, 1)
    assert "pip install plotly" in done.stderr
    assert not Path("page.html").exists()


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("", "--output FILE.html, --output FOLDER or --json"),
        ("-o file", "the folder cannot be created"),
        ("-o a.html --units si", "unknown option --units"),
        ("-o a.html --free dihedral", "--dihedral and --sweep define its values in a report"),
        ("-o a.html --dihedral 5 --dynamics unsteady", "more than seven states"),
        (f"-o a.html --aircraft {ROOT}/examples/pendulum.py:PENDULUM", "declares no schedule"),
        (f"-o a.html --aircraft {UAV} --flights {FLIGHTS}", "flights of the paper's aircraft"),
        (f"-o a.html --aircraft {UAV} --free speed", "--at and --sweep define its values"),
        (f"-o a.html --aircraft {UAV} --dihedral 3", "takes --at VALUE"),
        ("-o a.html --conditions book.csv", "--conditions"),
    ],
)
def test_wrong_options_of_report_are_refused(words, named):
    """Wrong options of `hfa report` are refused, and no file is written."""
    Path("file").write_text("a file")
    assert_refused(hfa("report", *words.split()), BAD_INPUT, named)
    assert list(Path().iterdir()) == [Path("file")]


def test_a_slider_ends_at_declared_limits_or_beyond_the_default_trim():
    """A slider ends at 1.5 times the value at the default trim. A value of 0 there is refused
    unless the variable has limits, which are then the ends.
    """

    def rates(x, u, p, w):
        return {"speed": u.thrust - x.speed}, {}

    states, inputs = {"speed": Signal("m/s")}, {"thrust": Signal("N")}
    model = Model("rest", states, inputs, rates, trim={"speed": 0.0}, schedule="speed")
    with pytest.raises(BadInputError, match="declare its min and max"):
        values_about(trim(model))
    limited = replace(model, states={"speed": Signal("m/s", min=-1.0, max=3.0)})
    values = values_about(trim(limited))
    assert (values[0], values[-1]) == (-1.0, 3.0)
    assert 0.0 in values
    assert values_about(trim(replace(model, trim={"speed": 4.0})))[-1] == 6.0


@pytest.mark.slow
def test_other_parameters_fail_and_are_distinguished_from_those_of_stored_flights():
    """With the parameters of another study, the printed pairs are not regenerated, and the page
    states that its stored flights are those of another aircraft.
    """
    words = ("--dihedral", "15", "--sweep", "15", "--parameters", "gibson-2011-simulation")
    result = hfa("report", "-o", "page.html", *words, "--flights", str(FLIGHTS))
    assert (result.code, "Both printed pairs regenerated: NO" in result.out) == (FAILED, True)
    html = page_of(Path("page.html"))
    assert "ANOTHER aircraft" in html
    assert "for this page&#x27;s aircraft" not in html


@pytest.mark.parametrize(
    "place", [["schema"], ["models", 0, "A", 0], ["flights", 0, "best", "cost"]]
)
def test_damaged_results_of_a_study_are_refused(place):
    """A file of stored flights with a text in place of an entry is refused in one line.

    place: keys and indices of the entry
    """
    data = json.loads((FLIGHTS / "best_flights.json").read_text("utf-8"))
    Path("best_flights.json").write_text(json.dumps(replaced(data, place, "x")))
    words = ("report", "--dihedral", "15", "--json", "--flights", "best_flights.json")
    assert_refused(hfa(*words), BAD_INPUT, "an entry is missing or wrong")
