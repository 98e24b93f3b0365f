"""The documentation is true: what it shows runs and prints what it says, its links lead somewhere."""

from __future__ import annotations

import re
import runpy
from pathlib import Path

import numpy as np
import pytest
from documents import blocks_of, complaints, difference
from project import PACKAGES, ROOT

from hfa_cli.main import COMMANDS, MOVED

DOCUMENTS = [ROOT / "README.md", *sorted((ROOT / "docs").glob("*.md"))]


def text_of(path: Path) -> str:
    return path.read_text(encoding="utf-8")


def is_slow(path: Path) -> bool:
    return any(block.slow for block in blocks_of(text_of(path)))


CASES = [
    *(pytest.param(path, False, id=path.stem) for path in DOCUMENTS),
    *(pytest.param(path, True, id=f"{path.stem} whole", marks=pytest.mark.slow) for path in filter(is_slow, DOCUMENTS)),
]


@pytest.mark.parametrize(("path", "slow"), CASES)
def test_blocks_run_and_print_what_is_shown(
    path: Path, slow: bool, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.chdir(tmp_path)
    for folder in ("examples", "studies"):
        (tmp_path / folder).symlink_to(ROOT / folder)
    assert "\n\n".join(complaints(text_of(path), name=path.name, slow=slow)) == ""
    if path.stem == "README":
        assert_is_that_of_the_documents(tmp_path / "verify.png")


def test_every_document_is_read() -> None:
    assert {path.stem for path in DOCUMENTS} >= {"README", "critics", "dynamics", "game", "identification", "trim"}
    for path in DOCUMENTS:
        assert blocks_of(text_of(path)), f"{path} shows nothing that can be checked"


@pytest.mark.parametrize("path", [*DOCUMENTS, ROOT / "CHANGELOG.md", ROOT / "ARCHITECTURE.md"], ids=lambda p: p.stem)
def test_links_lead_to_files_and_headings(path: Path) -> None:
    for link in re.findall(r"\]\(([^)\s]+)\)", text_of(path)):
        if re.match(r"https?://", link):
            continue
        target, _, heading = link.partition("#")
        file = path.parent / target if target else path
        assert file.exists(), link
        assert not heading or heading in headings(text_of(file)), link


def headings(document: str) -> list[str]:
    """Anchors of the headings, as GitHub makes them."""
    titles = re.findall(r"^#+ (.*)$", document, re.M)
    return [re.sub(r"[^\w\- ]", "", title.lower()).replace(" ", "-") for title in titles]


def test_the_readme_names_every_command() -> None:
    names = [name for name in COMMANDS if name not in MOVED]
    assert [name for name in names if not re.search(rf"`(hfa )?{name}\b", text_of(ROOT / "README.md"))] == []


def assert_is_that_of_the_documents(picture: Path) -> None:
    from matplotlib.image import imread

    one, other = imread(ROOT / "docs" / "pictures" / picture.name), imread(picture)
    assert one.shape == other.shape
    different = np.abs(one - other).max(axis=2) > 0.1
    height, width = different.shape
    different[: height // 2, 2 * width // 3 :] = False  # the map of the difference shows rounding
    assert np.mean(different) < 0.005, "run `hfa verify --dihedral 15 --picture docs/pictures/verify.png`"


def test_every_public_name_is_in_an_example() -> None:
    blocks = (block for path in DOCUMENTS for block in blocks_of(text_of(path)))
    code = "\n".join(block.text for block in blocks if block.language == "python")
    stubs = {name: ROOT / name / "__init__.pyi" for name in PACKAGES if name != "hfa_cli"}
    names = [(package, name) for package, stub in stubs.items() for name in re.findall(r" as (\w+)", text_of(stub))]
    assert [each for each in names if not re.search(rf"\b{each[1]}\b", code)] == []
    assert len(names) > 90


#: Examples that print nothing by themselves: aircraft (tests/trim/test_own_models.py), a training script
#: (tests/verification/critic/test_trained_networks.py).
SILENT = ("f16", "gtm", "navion", "train_a_network")
SCRIPTS = [path for path in sorted((ROOT / "examples").glob("*.py")) if path.stem not in SILENT]


@pytest.mark.parametrize("path", SCRIPTS, ids=lambda path: path.stem)
def test_examples_run(
    path: Path, tmp_path: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture
) -> None:
    monkeypatch.chdir(tmp_path)
    runpy.run_path(str(path), run_name="__main__")
    said = capsys.readouterr().out
    shown = text_of(path).partition('"""')[2].partition('"""')[0].partition("prints\n")[2]
    assert shown.strip(), "the docstring of an example ends with what it prints"
    expected = "\n".join(line.removeprefix("    ") for line in shown.strip("\n").splitlines())
    assert difference(expected, said) == ""
    assert list(tmp_path.iterdir()) == []


# The judge itself.

SOUND = """
```python
a = 2
print(a)
```
prints
```text
2
```
```python
print(a + 1)
print("end")
```
```text
...
end
```
```console
$ make test
$ hfa --version
...
$ hfa --version
...
$ hfa trim --dihedral abc  # exit 2
hfa: --dihedral is 'abc'; give a finite number
```
"""


def test_a_sound_document_passes() -> None:
    assert complaints(SOUND) == []


@pytest.mark.parametrize(
    ("right", "wrong", "complaint"),
    [
        ("text\n2\n", "text\n3\n", "-3\n+2"),
        ("...\nend\n", "end\n", "+3"),
        ("text\n2\n", "json\n2\n", "+2"),
        ("a = 2", "a = b", "NameError"),
        ("python\na = 2", "txt\na = 2", "no python block before"),
        ("make test", "make tea", "no target 'tea'"),
        ("hfa --version\n...\n$ hfa --version", "hfa --version\n$ hfa --version", "+hfa 0"),
        ("  # exit 2", "", "exit code 2 instead of 0"),
        ("give a finite number", "give another", "-hfa: --dihedral is 'abc'; give another"),
        ("$ make test", "$ ls", "neither hfa nor make"),
        ("end\n```", "end\n```\n```python\nprint(1)\n```\n", "+1"),
        ("python\na = 2", "python slow\na = 2", "no python block before"),
    ],
)
def test_a_wrong_document_is_complained_about(right: str, wrong: str, complaint: str) -> None:
    planted = SOUND.replace(right, wrong, 1)
    assert planted != SOUND
    assert complaint in "\n".join(complaints(planted))


def test_dots_stand_for_any_lines_and_for_nothing_else() -> None:
    for expected in ("...", "...\nb\n...", "a\n...\nc", "a\n...\nb\nc", "...\n..."):
        assert difference(expected, "a\nb\nc\n") == ""
    for expected in ("", "a", "...\nb", "b\n...", "a\n...\nb", "c\n...\na", "a\nb\n...c"):
        assert difference(expected, "a\nb\nc\n") != ""
