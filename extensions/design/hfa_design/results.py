"""Types of the results that this extension writes to files."""

from __future__ import annotations
