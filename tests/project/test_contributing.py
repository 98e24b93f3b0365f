"""The first changes that CONTRIBUTING describes work as it says."""

import inspect
import re
import textwrap

import pytest
from project import ROOT

import hfa
from trim.reports import figures, sheet

TEXT = (ROOT / "CONTRIBUTING.md").read_text("utf-8")


def test_the_first_row_stands_in_the_sheet(monkeypatch):
    """With the lines of CONTRIBUTING at the end of `lift_and_drag`, the sheet of a level trim has the
    ratio of lift and weight.
    """
    (block,) = re.findall(r"```py\n(.*?)```", TEXT, re.S)
    source = inspect.getsource(figures.lift_and_drag) + textwrap.dedent(block).replace(
        "\n", "\n    "
    ).join(["    ", ""])
    namespace = dict(vars(figures))
    exec(source, namespace)
    for module in (figures, sheet):
        monkeypatch.setattr(module, "lift_and_drag", namespace["lift_and_drag"])
    uav = hfa.trim(hfa.load_model(f"{ROOT}/examples/uav.toml"))
    ratio = uav["lift"] / uav["weight"]
    assert uav.sheet["lift / weight"].value == pytest.approx(ratio, rel=1e-12)


def test_files_and_names_of_the_first_changes_exist():
    """Each file that the section names exists, and the functions and tables are in them."""
    section = TEXT[TEXT.index("## Your first change") :]
    files = set(re.findall(r"[\w/]+\.(?:py|md)\b", section))
    assert not [name for name in files if "/" in name and not (ROOT / name).exists()]
    assert hasattr(figures, "lift_and_drag")
    reasons = (ROOT / "verification/reasons.py").read_text("utf-8")
    assert "def _of_gain(" in reasons
    assert "class Mistake(" in reasons
    assert "\nOF_K = " in (ROOT / "tests/verification/test_reasons.py").read_text("utf-8")
