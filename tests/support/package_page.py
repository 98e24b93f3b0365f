"""The example package of docs/extending.md as files."""

from __future__ import annotations

import re
from pathlib import Path

from project import ROOT

PAGE = ROOT / "docs" / "extending.md"
_FILE = re.compile(r"^```\w+\n(# (\S+\.\w+)\n.*?)^```$", re.M | re.S)


def write_package(folder: Path) -> None:
    """Write each block of the page that begins with "# FILE" into a folder."""
    for text, name in _FILE.findall(PAGE.read_text("utf-8")):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
