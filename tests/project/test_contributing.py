"""The first change that CONTRIBUTING describes works as it says."""

import inspect
import re
import textwrap

import pytest
from project import ROOT

import hfa
from trim.reports import figures

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
    monkeypatch.setattr(figures, "lift_and_drag", namespace["lift_and_drag"])
    uav = hfa.trim(hfa.load_model(f"{ROOT}/examples/uav.toml"))
    ratio = uav["lift"] / uav["weight"]
    assert uav.sheet["lift / weight"].value == pytest.approx(ratio, rel=1e-12)
