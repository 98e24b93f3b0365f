"""Generator of documentation pages from executed notebooks, with code, tables and pictures."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

_PICTURE = '<img alt="Figure drawn by the code above" src="data:image/png;base64,{}">'


def notebook_page(path: Path) -> str:
    """Return the executed notebook at `path` as Markdown."""
    parts = []
    for cell in json.loads(path.read_text("utf-8"))["cells"]:
        source = "".join(cell["source"])
        if cell["cell_type"] == "markdown":
            parts.append(source)
            continue
        parts.append(f"```python\n{source.removeprefix('%matplotlib inline').strip()}\n```")
        parts += [_shown(output) for output in cell["outputs"]]
    return "\n\n".join(parts) + "\n"


def _shown(output: dict[str, Any]) -> str:
    """Return one output of a cell as a Markdown block."""
    data = {kind: "".join(content) for kind, content in output.get("data", {}).items()}
    html = data.get("text/html", "")
    if "image/png" in data:
        html = _PICTURE.format(data["image/png"].replace("\n", ""))
    if html:
        return f'```{{raw}} html\n<div class="output">\n{html}\n</div>\n```'
    text = "".join(output.get("text", data.get("text/plain", "")))
    return f"```text\n{text.rstrip()}\n```"
