"""An output never overwrites a file that the run has read. A failed run leaves no file."""

from __future__ import annotations

import shutil
from pathlib import Path

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import small, stored

from hfa.main import BAD_INPUT, DONE


def plant_of_parts() -> None:
    """Write the matrices of a plant to A.csv and B.csv."""
    np.savetxt("A.csv", [[0.0, 1.0], [-1.0, -1.0]], delimiter=",")
    np.savetxt("B.csv", [[0.0], [1.0]], delimiter=",")


OF_PARTS = "--Q 1,1 --R 1 --delta inf"


@pytest.mark.parametrize(
    ("words", "kept"),
    [
        (f"solve --model A.csv {OF_PARTS} -o B.csv", "B.csv"),
        (f"solve --model A.csv {OF_PARTS} -o ./A.csv", "A.csv"),
        (f"solve --model link.csv {OF_PARTS} -o A.csv", "A.csv"),
        (f"solve --model A.csv {OF_PARTS} -o link.csv", "A.csv"),
        ("verify --model plant.json --weights critics/a.json -o critics/a.json", "critics/a.json"),
        ("trim --aircraft navion.py:NAVION -o saved.json --start saved.json", "saved.json"),
    ],
)
def test_an_output_that_is_an_input_is_refused(words: str, kept: str) -> None:
    """An output that is also an input of the run is refused, even through a link.

    The input is unchanged.
    """
    plant_of_parts()
    Path("link.csv").symlink_to("A.csv")
    small("plant.json")
    Path("critics").mkdir()
    stored("critics/a.json", W=np.ones(3))
    shutil.copy(Path(__file__).parents[2] / "examples" / "navion.py", ".")
    assert hfa("trim", "--aircraft", "navion.py:NAVION", "-o", "saved.json").code == DONE
    before = Path(kept).read_bytes()
    assert_refused(hfa(*words.split()), BAD_INPUT, "input", "this run")
    assert Path(kept).read_bytes() == before


def test_outputs_are_written_beside_the_inputs() -> None:
    """An output is written into the folder of the input files."""
    plant_of_parts()
    assert hfa("solve", "--model", "A.csv", *OF_PARTS.split(), "-o", "result.csv").code == DONE
    assert Path("result.csv").is_file()
