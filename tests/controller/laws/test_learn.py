"""One entry to all laws: the same bits after an interruption, files that are whole, and refusals."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from learning_samples import PUBLISHED, QUADRATIC, lq, published, stable_game
from reference_riccati import relative_error

from controller.game.learning_result import LearningResult
from controller.laws import run
from controller.laws.certified import CertifiedLaw
from controller.laws.integral_rl import IntegralLearning
from controller.laws.learn import LAWS, learn
from controller.laws.published_law import PublishedLaw
from controller.samples.recording import random_pool
from hfa_model.support import files
from hfa_model.support.errors import BadInputError
from hfa_model.support.files import load_npz, save_npz

#: A short run of each law.
RUNS: dict[str, dict[str, Any]] = {
    "certified": {"tick": 0.1, "predefined_time": 8.0},
    "published": {
        "basis": "quadratic",
        "coordinates": "scaled",
        "gains": (100.0, 100.0),
        "predefined_time": 0.3,
        "step": 1e-3,
        "flight_start": (-0.2, -0.005, 0.0, 0.0, -0.05, 0.0),
    },
    "irl": {"iterations": 30},
}


def short_run(law: str, **more: Any) -> LearningResult:
    game, _ = published("5 deg")
    options = dict(RUNS[law])
    if law == "published":
        start = tuple(QUADRATIC.weights(lq("5 deg")[1].P))
        options |= {"initial_weights": start, "recorded_weights": start}
    return learn(game, law, seed=4, **options, **more)


def assert_same_bits(one: LearningResult, other: LearningResult) -> None:
    for name in ("times", "weights", "residual_norm", "law_residual_norm", "P", "K"):
        assert getattr(one, name).tobytes() == getattr(other, name).tobytes(), name
    assert one.to_dict() == other.to_dict()


class Interrupter:
    """A progress hook that interrupts the run at a fraction of it."""

    def __init__(self, at: float) -> None:
        self.at = at
        self.seen: list[float] = []

    def __call__(self, fraction: float, message: str) -> None:
        self.seen.append(fraction)
        if fraction >= self.at:
            raise KeyboardInterrupt


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("fraction", [0.05, 0.5, 0.7])
def test_resumed_run_gives_the_same_bits(law: str, fraction: float, tmp_path: Path) -> None:
    state = tmp_path / "state.npz"
    whole = short_run(law)
    stop = Interrupter(fraction)
    with pytest.raises(KeyboardInterrupt):
        short_run(law, progress=stop, save_state=state)
    assert stop.seen[-1] < 0.95
    done = load_npz(state)["tick"]
    assert 0 < done < len(whole.times)
    assert_same_bits(short_run(law, resume=state), whole)


def test_interrupted_twice_still_gives_the_same_bits(tmp_path: Path) -> None:
    state = tmp_path / "state.npz"
    with pytest.raises(KeyboardInterrupt):
        short_run("certified", progress=Interrupter(0.3), save_state=state)
    first = int(load_npz(state)["tick"])
    with pytest.raises(KeyboardInterrupt):
        short_run("certified", progress=Interrupter(0.6), save_state=state, resume=state)
    assert int(load_npz(state)["tick"]) > first
    assert_same_bits(short_run("certified", resume=state), short_run("certified"))


def test_interruption_between_reports_is_kept_too(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """Ctrl-C inside a tick: the state is that of the last whole tick."""
    whole, advance = short_run("certified"), CertifiedLaw.advance

    def interrupted(self: CertifiedLaw, tick: int, memory: Any) -> Any:
        if tick == 33:
            raise KeyboardInterrupt
        return advance(self, tick, memory)

    state = tmp_path / "state.npz"
    monkeypatch.setattr(CertifiedLaw, "advance", interrupted)
    with pytest.raises(KeyboardInterrupt):
        short_run("certified", save_state=state)
    monkeypatch.undo()
    assert int(load_npz(state)["tick"]) == 33
    assert_same_bits(short_run("certified", resume=state), whole)


@pytest.mark.parametrize("law", LAWS)
@pytest.mark.parametrize("part", ["advance", "observe"])
def test_an_interrupt_anywhere_in_a_tick_loses_that_tick_alone(
    law: str, part: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Ctrl-C before and after a step or a row is made, at several ticks of one run, resumed each time."""
    whole, state = short_run(law), tmp_path / "state.npz"
    process = {"certified": CertifiedLaw, "published": PublishedLaw, "irl": IntegralLearning}[law]
    made = getattr(process, part)
    for number, at in enumerate((1, 2, 17, 28)):
        kept: dict[str, Any] = {"resume": state} if number else {}

        def interrupted(self: Any, tick: int, memory: Any, at: int = at, late: bool = number % 2 == 1) -> Any:
            value = made(self, tick, memory) if tick != at or late else None
            if tick == at:
                raise KeyboardInterrupt
            return value

        monkeypatch.setattr(process, part, interrupted)
        with pytest.raises(KeyboardInterrupt):
            short_run(law, save_state=state, **kept)
        saved = load_npz(state)
        assert int(saved["tick"]) == (at if part == "advance" else at - 1)
        assert {len(saved[name]) for name in saved if name.startswith("history.")} == {int(saved["tick"]) + 1}
    monkeypatch.undo()
    assert_same_bits(short_run(law, resume=state), whole)


def test_state_of_a_finished_run_gives_its_result_again(tmp_path: Path) -> None:
    state = tmp_path / "state.npz"
    whole = short_run("irl", save_state=state)
    assert_same_bits(short_run("irl", resume=state), whole)


def test_state_of_another_run_is_refused(tmp_path: Path) -> None:
    state = tmp_path / "state.npz"
    short_run("certified", save_state=state)
    game, _ = published("5 deg")
    options = RUNS["certified"]
    for changed in (
        lambda: learn(published("15 deg")[0], seed=4, resume=state, **options),
        lambda: learn(game, seed=5, resume=state, **options),
        lambda: learn(game, seed=4, resume=state, **(options | {"tick": 0.2})),
        lambda: learn(game, seed=4, resume=state, pool=random_pool(game, 100, 9), **options),
        lambda: short_run("irl", resume=state),
    ):
        with pytest.raises(BadInputError, match="of a run with another game, stack, law, settings or version"):
            changed()


def test_state_of_another_version_is_refused(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    state = tmp_path / "state.npz"
    short_run("certified", save_state=state)
    monkeypatch.setattr(run, "toolchain_version", lambda: "0.0.9")
    with pytest.raises(BadInputError, match="or version"):
        short_run("certified", resume=state)


def test_files_that_are_no_state_are_refused(tmp_path: Path) -> None:
    with pytest.raises(BadInputError, match="no file"):
        short_run("certified", resume=tmp_path / "missing.npz")
    text = tmp_path / "text.npz"
    text.write_text("not an archive")
    with pytest.raises(BadInputError, match=r"is not a readable \.npz file"):
        short_run("certified", resume=text)
    other = tmp_path / "other.npz"
    np.savez(other, x=np.zeros(3))
    with pytest.raises(BadInputError, match="is not a state file"):
        short_run("certified", resume=other)
    with pytest.raises(BadInputError, match="choose a folder that exists"):
        short_run("certified", save_state=tmp_path / "no" / "state.npz")


def test_a_file_is_whole_or_what_it_was(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    path = tmp_path / "kept.npz"
    save_npz(path, {"x": np.arange(4.0)})

    def broken(stream: Any, **arrays: Any) -> None:
        stream.write(b"half")
        raise KeyboardInterrupt

    monkeypatch.setattr(files.np, "savez", broken)
    with pytest.raises(KeyboardInterrupt):
        save_npz(path, {"x": np.zeros(4)})
    monkeypatch.undo()
    assert load_npz(path)["x"].tolist() == [0.0, 1.0, 2.0, 3.0]
    assert [entry.name for entry in tmp_path.iterdir()] == ["kept.npz"]


@pytest.mark.parametrize("law", LAWS)
def test_progress_rises_to_one_and_nothing_is_printed(law: str, capsys: pytest.CaptureFixture[str]) -> None:
    seen: list[tuple[float, str]] = []
    short_run(law, progress=lambda fraction, message: seen.append((fraction, message)))
    fractions = [fraction for fraction, _ in seen]
    assert fractions == sorted(fractions)
    assert 5 <= len(fractions) <= 100
    assert fractions[-1] == 1.0
    assert all("t = " in message and "residual" in message and "\n" not in message for _, message in seen)
    assert capsys.readouterr() == ("", "")


@pytest.mark.parametrize("law", LAWS)
def test_the_seed_decides_every_bit(law: str) -> None:
    assert_same_bits(short_run(law), short_run(law))
    game, _ = published("5 deg")
    options = RUNS[law] | ({"initial_weights": 1.0, "recorded_weights": 1.0} if law == "published" else {})
    if law != "published":
        assert learn(game, law, 1, **options).weights.tobytes() != learn(game, law, 2, **options).weights.tobytes()


@pytest.mark.parametrize("law", LAWS)
def test_results_survive_saving_bit_by_bit(law: str, tmp_path: Path) -> None:
    result = short_run(law)
    path = tmp_path / "result.npz"
    result.save(path)
    again = LearningResult.load(path)
    assert_same_bits(again, result)
    assert again.certificates == result.certificates
    assert again.excitation == result.excitation
    assert again.converged == result.converged


@pytest.mark.parametrize("law", LAWS)
def test_results_are_plain_json(law: str) -> None:
    result = short_run(law)
    plain = json.loads(json.dumps(result.to_dict(), allow_nan=False))
    assert plain["law"] == law
    assert plain["status"] == result.status
    assert np.array_equal(np.array(plain["P"]), result.P)
    assert plain["settings"]["basis" if law != "irl" else "form"] in ("quadratic", "game")
    assert [row["ok"] for row in plain["certificates"]] == [row.ok for row in result.certificates]
    assert plain["excitation"]["rank"] == 21


def test_a_time_that_never_comes_is_null(tmp_path: Path) -> None:
    result = short_run("published")
    assert result.settling_time == np.inf
    assert result.to_dict()["settling_time"] is None
    result.save(tmp_path / "r.npz")
    assert LearningResult.load(tmp_path / "r.npz").settling_time == np.inf


def test_files_that_are_no_result_are_refused(tmp_path: Path) -> None:
    path = tmp_path / "other.npz"
    np.savez(path, x=np.zeros(3))
    with pytest.raises(BadInputError, match="is not a learning result of this version"):
        LearningResult.load(path)
    np.savez(path, header=np.array(json.dumps({"schema": "hfa.learning-result/0"})))
    with pytest.raises(BadInputError, match="is not a learning result of this version"):
        LearningResult.load(path)


def test_unknown_laws_and_settings_name_the_choices() -> None:
    game = stable_game()
    with pytest.raises(BadInputError, match="unknown law 'magic'; choose one of: certified, published, irl"):
        learn(game, "magic")
    with pytest.raises(
        BadInputError, match=r"law 'certified' has no setting 'gamma'; choose from: predefined_time, tick"
    ):
        learn(game, gamma=0.01)


def test_recorded_data_can_be_handed_in() -> None:
    game, exact = published(PUBLISHED[0])
    result = learn(game, pool=random_pool(game, 60, seed=8), tick=0.1)
    assert result.converged
    assert relative_error(result.P, exact.P) < 1e-9
    assert result.excitation.samples == 50
