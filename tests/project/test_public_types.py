"""The types of public names, checked by mypy on the scripts of documents and notebooks."""

import json
import os
import re
import subprocess
import sys

import pytest
from project import FOLDERS, ROOT

#: Folders in a user's import path.
FOLDERS_ABOVE = {folder.parent for folder in FOLDERS.values()}


def scripts_of_documents():
    """Return name -> Python code of each document and notebook."""
    found = {}
    for path in (ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))):
        blocks = re.findall(r"^```python\n(.*?)^```", path.read_text("utf-8"), re.S | re.M)
        if blocks:
            found[f"doc_{path.stem.lower()}.py"] = "\n\n".join(blocks)
    for path in sorted((ROOT / "examples").glob("*.ipynb")):
        cells = json.loads(path.read_text("utf-8"))["cells"]
        code = ["".join(cell["source"]) for cell in cells if cell["cell_type"] == "code"]
        found[f"notebook_{path.stem}.py"] = re.sub(r"^%.*$", "", "\n\n".join(code), flags=re.M)
    return found


#: Parts of messages of mypy that show no wrong type of this project: "None" of optional results,
#: which exist in the document, and NumPy's declaration of savez.
ACCEPTED_MESSAGES = ("None", '"savez"')


def document_errors(folder, scripts):
    """Return the errors of mypy --strict in scripts, apart from `ACCEPTED_MESSAGES`."""
    for name, text in scripts.items():
        (folder / name).write_text(text, encoding="utf-8")
    options = "--strict --follow-imports=silent --ignore-missing-imports"
    options += " --allow-untyped-defs --allow-untyped-calls"
    done = subprocess.run(
        [sys.executable, "-m", "mypy", *options.split(), *scripts],
        cwd=folder,
        env={**os.environ, "MYPYPATH": os.pathsep.join(map(str, FOLDERS_ABOVE))},
        capture_output=True,
        text=True,
        timeout=600,
    )
    errors = [line for line in done.stdout.splitlines() if " error: " in line]
    return [line for line in errors if not any(words in line for words in ACCEPTED_MESSAGES)]


@pytest.mark.slow
def test_mypy_accepts_the_documents(tmp_path):
    """mypy --strict accepts the code in documents and notebooks, but for `ACCEPTED_MESSAGES`. In a
    planted script, it reports the attribute `zeta`, which the result of `hfa.trim` does not have.
    """
    pytest.importorskip("mypy")
    scripts = scripts_of_documents()
    assert len(scripts) > 10
    assert document_errors(tmp_path, scripts) == []
    planted = {"doc_planted.py": "import hfa\nhfa.trim(hfa.aircraft()).zeta\n"}
    assert len(document_errors(tmp_path, planted)) == 1
