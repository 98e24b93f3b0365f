"""`hfa reproduce`: what it writes, that it can go on where it was stopped, and that it says the same twice."""

from __future__ import annotations

import json
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import Terminal, assert_refused, hfa
from experiment_configurations import BRIEF, COARSE, Changes, changed
from matplotlib.figure import Figure

from hfa_cli.entry import INTERRUPTED
from hfa_cli.main import BAD_INPUT, DONE, FAILED
from hfa_support.reporting.figure import new_figure
from verification.experiments import configuration, reproduction as reproduce, result_folder as store
from verification.experiments.claims import CONFIRMED, NOT_CONFIRMED, NOT_DECIDABLE
from verification.experiments.flown_laws import PRINTED
from verification.experiments.panels import PaperFigure, draw
from verification.experiments.reproduction import EXPERIMENTS

FIGURES = {"5.1": range(3, 11), "5.2": range(11, 14), "5.3": range(14, 22), "5.4": range(22, 24)}


SHORT = (COARSE, BRIEF)
#: Those of two experiments are drawn; what a panel shows is tested in test_panels.py.
DRAWN = {3, 22, 23}


def plain(picture: PaperFigure) -> Figure:
    """Nothing, in place of a figure that takes half a second to draw."""
    return new_figure(1.0, 1.0)


@contextmanager
def configured(*changes: Changes) -> Iterator[None]:
    """Within the block, `hfa reproduce` has another configuration."""
    other = changed(*changes)
    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(configuration, "section5_configuration", lambda: other)
        yield


@pytest.fixture
def short() -> Iterator[None]:
    """One second of flight."""
    with configured(*SHORT):
        yield


@pytest.fixture
def unpainted(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(store, "draw", plain)


@pytest.fixture(scope="module")
def finished(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """All experiments, one second each; of figures that are alike one is drawn."""
    folder = tmp_path_factory.mktemp("all") / "out"
    with configured(*SHORT), pytest.MonkeyPatch.context() as patched:
        patched.setattr(store, "draw", lambda picture: (draw if picture.number in DRAWN else plain)(picture))
        result = hfa("reproduce", "all", "-o", str(folder))
    assert (result.code, result.err) == (DONE, "")
    assert result.out.splitlines()[-1] in (folder / "claims.md").read_text(encoding="utf-8")
    assert len(result.out.splitlines()) == 4 + sum(len(one.claims) for one in EXPERIMENTS.values())
    return folder


def table_of(folder: Path) -> dict[str, Any]:
    table: dict[str, Any] = json.loads((folder / "claims.json").read_text(encoding="utf-8"))
    return table


def contents(folder: Path) -> dict[str, bytes]:
    """File by file, but for the command that each is signed with."""
    return {str(path.relative_to(folder)): unsigned(path) for path in sorted(folder.rglob("*")) if path.is_file()}


def unsigned(path: Path) -> bytes:
    if path.suffix == ".json":
        data = json.loads(path.read_text("utf-8"))
        assert data.pop("provenance")["command"].startswith("hfa reproduce ")
        return json.dumps(data).encode()
    if path.suffix == ".npz":
        with np.load(path) as arrays:
            assert str(arrays["provenance.dynamics"]) == "published"
            return b"".join(arrays[name].tobytes() for name in arrays if not name.startswith("provenance."))
    if path.suffix == ".png":
        assert b"parameters identified (" in path.read_bytes()
    return path.read_bytes()


@pytest.mark.parametrize("section", EXPERIMENTS)
def test_every_figure_is_there_with_its_data(finished: Path, section: str) -> None:
    names = {f"figure-{number:02d}" for number in FIGURES[section]}
    expected = {f"{name}.{suffix}" for name in names for suffix in ("png", "npz")} | {"result.json"}
    assert {path.name for path in (finished / section).iterdir()} == expected
    for name in names:
        with np.load(finished / section / f"{name}.npz") as data:
            lines = {key.rpartition(" _ ")[0] for key in data.files if " _ " in key}
            assert lines
            for line in lines:
                assert len(data[f"{line} _ x"]) == len(data[f"{line} _ y"]) > 0
        assert (finished / section / f"{name}.png").read_bytes().startswith(b"\x89PNG")


def test_a_picture_shows_the_flight(finished: Path) -> None:
    with np.load(finished / "5.1" / "figure-03.npz") as data:
        command = next(data[key] for key in data.files if key.endswith("command _ y"))
        times = next(data[key] for key in data.files if key.endswith("command _ x"))
        speed = next(data[key] for key in data.files if key.endswith("exact + feed-forward _ y"))
    np.testing.assert_allclose(command, 7.0 + 0.01 * times + 2.0 * np.sin(0.5 * times), rtol=1e-12)
    assert speed[0] == 5.0
    assert abs(speed[-1] - command[-1]) < 0.1


def test_the_table_holds_every_claim_and_every_flight(finished: Path) -> None:
    table = table_of(finished)
    assert [one["number"] for one in table["claims"]] == [c.number for e in EXPERIMENTS.values() for c in e.claims]
    assert sum(table["verdicts"].values()) == len(table["claims"])
    for one in table["claims"]:
        assert one["verdict"] in (CONFIRMED, NOT_CONFIRMED, NOT_DECIDABLE)
        holds = one["findings"][one["subject"]]["holds"]
        assert one["verdict"] == NOT_DECIDABLE or holds == (one["verdict"] == CONFIRMED)
        assert one["reason"]
    assert {flight["law"] for flight in table["lost_flights"]} == {PRINTED}
    assert table["own_failures"] == []
    assert len(table["lost_flights"]) == sum(
        flight["law"] == PRINTED for one in table["experiments"] for flight in one["flights"]
    )
    markdown = (finished / "claims.md").read_text(encoding="utf-8")
    assert all(f"| {one['number']} |" in markdown for one in table["claims"])


def test_numbers_of_claims_are_unique() -> None:
    numbers = [claim.number for one in EXPERIMENTS.values() for claim in one.claims]
    assert len(set(numbers)) == len(numbers)


def test_resuming_simulates_nothing_again(finished: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    before = contents(finished)

    def refuse(*_: Any) -> None:
        raise AssertionError("simulated again")

    monkeypatch.setattr(reproduce, "simulate_plan", refuse)
    with configured(*SHORT):
        result = hfa("reproduce", "all", "-o", str(finished), "--resume", "--json")
        assert result.code == DONE
        assert json.loads(result.out) == table_of(finished)
        assert contents(finished) == before
        with pytest.raises(AssertionError, match="simulated again"):
            hfa("reproduce", "5.4", "-o", str(finished))
    with pytest.raises(AssertionError, match="simulated again"):
        # Another configuration is another experiment.
        hfa("reproduce", "5.4", "-o", str(finished), "--resume", "--workers", "1")
    monkeypatch.setattr("hfa_support.jobs.finished.toolchain_version", lambda: "0.0.9")
    with configured(*SHORT), pytest.raises(AssertionError, match="simulated again"):
        hfa("reproduce", "all", "-o", str(finished), "--resume")
    assert contents(finished) == before


@pytest.mark.usefixtures("short")
def test_the_same_run_gives_the_same_bits(finished: Path, tmp_path: Path) -> None:
    folder = tmp_path / "again"
    assert hfa("reproduce", "5.4", "-o", str(folder)).code == DONE
    again = contents(folder / "5.4")
    assert len(again) == 5
    assert again == contents(finished / "5.4")


@pytest.mark.slow
@pytest.mark.usefixtures("short")
def test_the_other_figures_are_drawn_too(tmp_path: Path) -> None:
    for section in ("5.1", "5.2", "5.3"):
        assert hfa("reproduce", section, "-o", str(tmp_path)).code == DONE
    pictures = [
        tmp_path / section / f"figure-{n:02d}.png" for section in FIGURES for n in FIGURES[section] if n not in DRAWN
    ]
    assert min(path.stat().st_size for path in pictures) > 20_000


@pytest.mark.usefixtures("short", "unpainted")
def test_a_damaged_result_is_made_anew(tmp_path: Path) -> None:
    words = ("reproduce", "5.4", "-o", str(tmp_path / "out"), "--resume")
    assert hfa(*words).code == DONE
    before = contents(tmp_path / "out")
    (tmp_path / "out" / "5.4" / "figure-22.png").unlink()
    (tmp_path / "out" / "5.4" / "stray").write_text("old")
    assert hfa(*words).code == DONE
    assert contents(tmp_path / "out") == before
    (tmp_path / "out" / "5.4" / "result.json").write_text("{")
    assert hfa(*words).code == DONE
    assert contents(tmp_path / "out") == before


@pytest.mark.usefixtures("short")
def test_an_interruption_leaves_nothing_half_written(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    def interrupt(*_: Any) -> None:
        raise KeyboardInterrupt

    monkeypatch.setattr(store, "save", interrupt)
    result = hfa("reproduce", "5.4", "-o", str(tmp_path / "out"))
    assert result.code == INTERRUPTED
    assert list((tmp_path / "out").iterdir()) == []


@pytest.mark.usefixtures("short")
def test_progress_is_for_a_terminal(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(reproduce, "write_outcome", lambda outcome, _, origin: store.result_of(outcome, (), origin))
    terminal = Terminal()
    words = ("reproduce", "5.4", "-o", str(tmp_path))
    assert hfa(*words, err=terminal).code == DONE
    assert "reproduce 5.4:  50 %" in terminal.getvalue()
    assert terminal.getvalue().endswith("\r\033[K")  # and without one nothing is said: `finished`


@pytest.mark.parametrize(
    ("words", "named"),
    [
        (("5.5", "-o", "out"), "no experiment '5.5'"),
        (("5.1",), "-o"),
        (("5.1", "-o", "nowhere/out"), "cannot make the folder"),
        (("5.1", "-o", "file"), "cannot make the folder"),
        (("5.1", "-o", "out", "--matrices", "guessed"), "unknown matrices 'guessed'"),
        (("5.1", "-o", "out", "--reading", "file"), "--reading is no longer there: the configuration is that of"),
    ],
)
def test_bad_input_is_one_line(
    words: tuple[str, ...], named: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    Path("file").write_text("")
    assert_refused(hfa("reproduce", *words), BAD_INPUT, named)
    assert [path.name for path in tmp_path.iterdir()] == ["file"]


@pytest.mark.usefixtures("unpainted")
def test_a_law_of_ours_that_is_lost_is_a_failure(tmp_path: Path) -> None:
    """A wrong plant is unstable under every gain: the exact law is lost, and the exit code says so."""
    with configured(*SHORT, {"uncertainty": {"factors": (0.0, 0.1, 0.3, -30.0)}}):
        result = hfa("reproduce", "5.3", "-o", str(tmp_path / "out"), "--json")
    assert result.code == FAILED
    table = json.loads(result.out)
    assert "5.3: 5 deg, exact, A - 30 A" in table["own_failures"]
    invariant = next(one for one in table["claims"] if one["number"] == "5.3-2")
    assert invariant["verdict"] == NOT_CONFIRMED
    assert not any(found["holds"] for found in invariant["findings"].values())
