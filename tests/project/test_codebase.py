"""The files of the project: none mentions where it was written."""

from __future__ import annotations

import re
import subprocess

import pytest
from project import ROOT

#: Spelled in two halves, so that this file does not mention it.
WORKPLACE = re.compile("/wo" + "rk/|/tmp/bri" + "ef")


def stored() -> list[str]:
    """The files that git keeps."""
    listed = subprocess.run(["git", "ls-files", "-z"], cwd=ROOT, capture_output=True, check=False)
    if listed.returncode or not listed.stdout:
        pytest.skip("not a checkout of the repository")
    return [name for name in listed.stdout.decode().split("\0") if name and (ROOT / name).is_file()]


def test_nothing_mentions_where_it_was_written() -> None:
    texts = {name: (ROOT / name).read_bytes().decode("utf-8", "replace") for name in stored()}
    assert {"README.md", ".ci/run"} <= texts.keys()
    assert [name for name, text in texts.items() if WORKPLACE.search(text)] == []
    assert WORKPLACE.search("see /wo" + "rk/notes")
    assert not WORKPLACE.search("framework/notes and network/x")
