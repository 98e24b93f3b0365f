"""Files of the example package in docs/extending.md."""

import re

from project import ROOT

PAGE = ROOT / "docs" / "extending.md"
_FILE = re.compile(r"^```\w+\n(# (\S+\.\w+)\n.*?)^```$", re.M | re.S)


def write_package(folder):
    """Write the code blocks of docs/extending.md that begin with "# FILE" to files in a folder."""
    for text, name in _FILE.findall(PAGE.read_text("utf-8")):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")
