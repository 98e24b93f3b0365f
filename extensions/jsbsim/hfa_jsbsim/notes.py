"""Notes for the user about an aircraft's files, grouped by statement."""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

#: Ranks of notes, in the order in which they are printed. FORCE: a force may differ from JSBSim's.
#: MOTION: only the motion may differ. IDLE: nothing differs in flight.
FORCE = 0
MOTION = 1
IDLE = 2
#: Largest number of subjects that a note lists for one file.
_MOST = 12


class Note(NamedTuple):
    """Note about an element of a file.

    statement: the statement
    subject: part of the file that the statement concerns, "" for the whole file
    where: file and line
    rank: FORCE, MOTION or IDLE, from the most to the least important
    """

    statement: str
    subject: str = ""
    where: str = ""
    rank: int = FORCE


def grouped(notes: Iterable[Note]) -> list[str]:
    """Return one line for each statement, with its subjects, files and lines.

    Notes of rank FORCE come first, then MOTION and IDLE.
    """
    by_statement: dict[tuple[int, str], list[Note]] = {}
    for note in sorted(notes, key=lambda note: note.rank):
        by_statement.setdefault((note.rank, note.statement), []).append(note)
    return [_line(statement, group) for (_, statement), group in by_statement.items()]


def _line(statement: str, notes: list[Note]) -> str:
    """Return a statement followed by its subjects, files and lines, at most `_MOST` per file."""
    by_file: dict[str, list[str]] = {}
    for note in dict.fromkeys(notes):
        file, _, line = note.where.rpartition(":")
        by_file.setdefault(file, []).append(f"{line} {note.subject}".strip())
    files = []
    for file, subjects in by_file.items():
        texts = [text for text in subjects[:_MOST] if text]
        if len(subjects) > _MOST:
            texts.append(f"{len(subjects) - _MOST} more")
        files.append(f"{file}: {', '.join(texts)}" if file else ", ".join(texts))
    listed = "; ".join(text for text in files if text)
    return f"{statement}: {listed}" if listed else statement
