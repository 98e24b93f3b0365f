"""What killed runs leave is cleared by the next, and what running ones hold is not."""

from __future__ import annotations

import subprocess
import sys
from pathlib import Path

from hfa_model.support.files import write_text
from hfa_model.support.temporary import temporary_file, temporary_folder

HOLD = """
import sys
from pathlib import Path
from hfa_model.support.temporary import temporary_file, temporary_folder
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
