"""Readings of Section 5 that are flown in seconds: the project's own with some lines changed."""

from __future__ import annotations

from importlib.resources import files
from pathlib import Path

#: One second of flight, so that a whole experiment takes seconds.
SHORT = {
    "step = 1e-4": "step = 1e-3",
    "duration = 20.0": "duration = 1.0",
    "predefined_time = [10.0, 5.0, 5.0, 5.0]": "predefined_time = [0.5, 0.5, 0.5, 0.5]",
    "late = [10.0, 20.0]": "late = [0.5, 1.0]",
    "short_adjustment = 5.0": "short_adjustment = 0.5",
}


def text_of_reading() -> str:
    return files("verification.experiments").joinpath("section5.toml").read_text(encoding="utf-8")


def changed(text: str, changes: dict[str, str]) -> str:
    """The text with lines replaced; every line to replace must be there once."""
    for old, new in changes.items():
        assert text.count(f"\n{old}\n") == 1, old
        text = text.replace(f"\n{old}\n", f"\n{new}\n")
    return text


def reading_file(folder: Path, changes: dict[str, str]) -> Path:
    path = folder / "section5.toml"
    path.write_text(changed(text_of_reading(), changes), encoding="utf-8")
    return path
