"""Messages about wrong files."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import pytest

from hfa_support import BadInputError


def refusal(load: Callable[[str], object], path: Path) -> str:
    """The message with which a file is refused: one line that names the file."""
    with pytest.raises(BadInputError) as caught:
        load(str(path))
    message = str(caught.value)
    assert "\n" not in message
    assert str(path) in message
    return message
