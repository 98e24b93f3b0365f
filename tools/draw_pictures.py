"""Draw the pictures of docs/pictures/NAME, those of the commands in docs/NAME.md."""

import sys
from importlib import import_module

sys.path[:0] = ["tests/support", "tests/project", "."]
import_module("test_docs").illustrate()
