"""Executes the notebooks in examples/ in a kernel; as a script it stores their outputs in them."""

from __future__ import annotations

from pathlib import Path
from typing import Any

EXAMPLES = Path(__file__).parents[2] / "examples"


def executed(path: Path) -> Any:
    """The notebook with its outputs, without times."""
    import nbformat
    from nbclient import NotebookClient

    notebook = nbformat.read(path, as_version=4)
    return NotebookClient(notebook, timeout=120, record_timing=False).execute()


if __name__ == "__main__":
    import nbformat

    for each in sorted(EXAMPLES.glob("*.ipynb")):
        nbformat.write(executed(each), each)
