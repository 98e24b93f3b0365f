"""What killed runs leave is cleared by the next, and what running ones hold is not."""

from __future__ import annotations

import contextlib
import shutil
import subprocess
import sys
from collections.abc import Callable
from pathlib import Path
from types import FrameType
from typing import Any

import pytest

from hfa_support import files, temporary
from hfa_support.files import write_text
from hfa_support.temporary import remove_what_is_there, temporary_file, temporary_folder

HOLD = """
import sys
from pathlib import Path
from hfa_support.temporary import temporary_file, temporary_folder
with temporary_file(Path(sys.argv[1]), ".a.json.", ".part"), temporary_folder(Path(sys.argv[1]), "members-") as folder:
    (folder / "chunk").touch()
    print("there", flush=True)
    sys.stdin.read()
"""


def test_a_killed_run_s_files_and_folders_go_with_the_next_and_a_running_one_s_stay(tmp_path: Path) -> None:
    (tmp_path / ".a.json.part").write_text("somebody's own")
    words = [sys.executable, "-c", HOLD, str(tmp_path)]
    with subprocess.Popen(words, stdin=subprocess.PIPE, stdout=subprocess.PIPE, text=True) as run:
        assert run.stdout is not None
        assert run.stdout.readline() == "there\n"
        held = set(tmp_path.iterdir())
        assert len(held) == 3
        write_text(tmp_path / "a.json", "1")
        with temporary_folder(tmp_path, "members-") as folder:
            assert set(tmp_path.iterdir()) == held | {folder, tmp_path / "a.json"}
        run.kill()
    assert set(tmp_path.iterdir()) == held | {tmp_path / "a.json"}, "a killed run cannot clear up"
    write_text(tmp_path / "a.json", "2")
    with temporary_folder(tmp_path, "members-") as folder:
        assert set(tmp_path.iterdir()) == {tmp_path / ".a.json.part", tmp_path / "a.json", folder}
    assert (tmp_path / "a.json").read_text() == "2"


def test_they_go_after_the_block_unless_they_were_renamed(tmp_path: Path) -> None:
    with temporary_file(tmp_path, "a", "b") as path, temporary_folder(tmp_path, "c") as folder:
        (folder / "inside").touch()
        assert path.is_file()
    assert list(tmp_path.iterdir()) == []
    with temporary_file(tmp_path, "a", "b") as path, temporary_folder(tmp_path, "c") as folder:
        path.rename(tmp_path / "kept")
        folder.rename(tmp_path / "folder")
    assert sorted(each.name for each in tmp_path.iterdir()) == ["folder", "kept"]


def test_a_folder_that_another_run_clears_before_it_is_locked_is_made_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    made = list[Path]()
    make = Path.mkdir

    def make_and_lose(self: Path, mode: int = 0o777) -> None:
        make(self, mode)
        made.append(self)
        if len(made) == 1:
            self.rmdir()

    monkeypatch.setattr(Path, "mkdir", make_and_lose)
    with temporary_folder(tmp_path, "unfinished-") as folder:
        assert made == [folder, folder]
        assert folder.is_dir()
    assert list(tmp_path.iterdir()) == []
    with pytest.raises(FileNotFoundError), temporary_folder(tmp_path / "none", "unfinished-"):
        pass


def _file(folder: Path) -> None:
    write_text(folder / "result", "whole")


def _folder(folder: Path) -> None:
    with temporary_folder(folder, ".folder.") as unfinished:
        (unfinished / "inside").mkdir()
        (unfinished / "result").write_text("whole")
        (unfinished / "result").rename(folder / "result")


def _interrupted(work: Callable[[Path], None], folder: Path, step: int) -> bool:
    """Ctrl-C at that line, call or return of the work; whether it came."""
    watched, steps = {each.__file__ for each in (contextlib, shutil, files, temporary)}, 0

    def trace(frame: FrameType, *_: object) -> Any:
        nonlocal steps
        if frame.f_code.co_filename not in watched:
            return None
        steps += 1
        if steps == step:
            raise KeyboardInterrupt
        return trace

    before = sys.gettrace()
    sys.settrace(trace)
    try:
        work(folder)
    except (KeyboardInterrupt, OSError):  # rmtree, interrupted as it closes a folder, closes it twice
        pass
    finally:
        sys.settrace(before)
    return steps >= step


@pytest.mark.filterwarnings("ignore::pytest.PytestUnraisableExceptionWarning")
@pytest.mark.parametrize("work", [_file, _folder])
def test_wherever_a_signal_comes_nothing_is_left_when_the_process_ends(
    tmp_path: Path, work: Callable[[Path], None]
) -> None:
    step, whole = 0, 0
    while _interrupted(work, tmp_path, step := step + 1):
        remove_what_is_there()
        assert [each.name for each in tmp_path.iterdir()] in ([], ["result"]), step
        for result in tmp_path.iterdir():
            assert result.read_text() == "whole"
            result.unlink()
            whole += 1
    assert step > 100
    assert 0 < whole < step


IN_A_CYCLE = """
import sys
from pathlib import Path
from types import SimpleNamespace
from hfa_support.temporary import temporary_folder
held = SimpleNamespace(around=temporary_folder(Path(sys.argv[1]), "members-"))
held.itself = held
held.around.__enter__()
del held
print(len(list(Path(sys.argv[1]).iterdir())))
"""


def test_what_only_a_cycle_of_garbage_refers_to_goes_when_the_process_ends(tmp_path: Path) -> None:
    done = subprocess.run([sys.executable, "-c", IN_A_CYCLE, str(tmp_path)], capture_output=True, text=True, check=True)
    assert (done.stdout, done.stderr, list(tmp_path.iterdir())) == ("1\n", "", [])
