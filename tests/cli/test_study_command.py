"""The study of the paper's law through the command line."""

from __future__ import annotations

import contextlib
import json
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli import Result, Terminal, hfa

from controller.study import published_study, study_rows
from controller.study.published_study import PlannedRun, Reference, StudyRun
from controller.study.study_rows import STUDY
from hfa_cli.entry import INTERRUPTED
from hfa_cli.main import DONE


def test_the_study_keeps_finished_rows_and_takes_them_up_again(monkeypatch: pytest.MonkeyPatch) -> None:
    def stop(_: object, fraction: float, row: str) -> None:
        if row.startswith("learning alone"):
            raise KeyboardInterrupt

    monkeypatch.setitem(study_rows._IMPLICIT, "step", 0.1)  # a tenth of the steps
    words = ("study", "--only", "learning alone, frozen", "--only", "theorem gains, explicit", "--folder", "rows")
    names = ["theorem gains, explicit", "learning alone, frozen, implicit"]
    with monkeypatch.context() as patched:
        patched.setattr("hfa_cli.progress.ProgressLine.say", stop)
        assert hfa(*words, err=Terminal()).code == INTERRUPTED
    assert [path.name for path in Path("rows").iterdir()] == ["theorem-gains-explicit.json"]
    kept = json.loads(
        Path("rows", "theorem-gains-explicit.json").read_text(encoding="utf-8"), parse_constant=pytest.fail
    )
    whole = hfa(*words, "--resume", "-o", "study.json", err=Terminal())
    assert whole.code == DONE
    assert "study: 100 %" in whole.err
    assert names[0] not in whole.err
    data = json.loads(Path("study.json").read_text(encoding="utf-8"), parse_constant=pytest.fail)
    assert data["rows"][0] == kept["rows"][0]
    counts = [(row["name"], row["count"], row["overflow"], row["certified"]) for row in data["rows"]]
    assert counts == [(names[0], 48, 48, 0), (names[1], 4, 0, 0)]
    for name in names:
        assert f"\n{name}: {STUDY[name].cause}" in whole.out

    def refuse(*_: object) -> None:
        raise AssertionError("a finished row is run again")

    monkeypatch.setattr("controller.study.published_study._run", refuse)
    for suffix in ("json", "npz", "mat", "csv"):
        again = hfa(*words, "--resume", "-o", f"again.{suffix}")
        assert (again.code, again.out, again.err) == (DONE, whole.out, "")
    first, second = (json.loads(Path(name).read_text(encoding="utf-8")) for name in ("study.json", "again.json"))
    assert first | {"provenance": None} == second | {"provenance": None}
    assert len(Path("again.csv").read_text(encoding="utf-8").splitlines()) == 1 + 48 + 4
    with pytest.raises(AssertionError, match="is run again"):
        hfa(*words)


QUICK = ("study", "--only", "theorem gains, explicit", "--folder", "rows", "--resume")


@pytest.fixture(scope="module")
def runs() -> Iterator[list[PlannedRun]]:
    """Every run that is asked for; each is made once."""
    asked: list[PlannedRun] = []
    known: dict[str, StudyRun] = {}
    run = published_study._run

    def remembered(reference: Reference, planned: PlannedRun) -> StudyRun:
        asked.append(planned)
        if (key := repr(planned)) not in known:
            known[key] = run(reference, planned)
        return known[key]

    with pytest.MonkeyPatch.context() as patched:
        patched.setattr(published_study, "_run", remembered)
        yield asked


@pytest.fixture(scope="module")
def whole(runs: list[PlannedRun], tmp_path_factory: pytest.TempPathFactory) -> tuple[Result, str]:
    """What a row said, and its file."""
    folder = tmp_path_factory.mktemp("study")
    with contextlib.chdir(folder):
        said = hfa(*QUICK)
    assert said.code == DONE
    return said, (folder / "rows" / "theorem-gains-explicit.json").read_text(encoding="utf-8")


@pytest.mark.parametrize(
    "damage",
    [
        lambda text: text.replace('"eta": 0.8', '"eta": 0.7') + "{",
        lambda text: text.replace('"identity": "', '"identity": "0'),
        lambda text: text.replace('"toolchain": "', '"toolchain": "0'),
        lambda text: text.replace("hfa.published-study/2", "hfa.published-study/0"),
        lambda text: "[1]",
    ],
)
def test_a_row_that_is_not_todays_is_run_again(
    whole: tuple[Result, str], runs: list[PlannedRun], damage: Callable[[str], str]
) -> None:
    said, text = whole
    file = Path("rows", "theorem-gains-explicit.json")
    file.parent.mkdir()
    file.write_text(damage(text), encoding="utf-8")
    runs.clear()
    assert file.read_text(encoding="utf-8") != text
    assert hfa(*QUICK) == said
    assert len(runs) == 48
    assert file.read_text(encoding="utf-8") == text


def test_a_row_of_another_version_is_run_again(whole: tuple[Result, str], monkeypatch: pytest.MonkeyPatch) -> None:
    said, text = whole
    file = Path("rows", "theorem-gains-explicit.json")
    file.parent.mkdir()
    file.write_text(text, encoding="utf-8")
    monkeypatch.setattr("hfa_support.jobs.finished.toolchain_version", lambda: "0.0.9")
    assert hfa(*QUICK) == said
    assert '"toolchain": "0.0.9"' in file.read_text(encoding="utf-8")
