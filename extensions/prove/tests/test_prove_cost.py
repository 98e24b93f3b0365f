"""Command `hfa prove cost`."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import pytest

import hfa
from hfa.main import main

EXAMPLES = Path(__file__).parents[3] / "examples"
PENDULUM = f"{EXAMPLES / 'pendulum.py'}:PENDULUM"
AIRCRAFT = ("--aircraft", PENDULUM)
SEALS = ("digest", "provenance", "checksum")


@pytest.fixture(scope="module")
def certificate(tmp_path_factory: pytest.TempPathFactory) -> Path:
    path = tmp_path_factory.mktemp("cost") / "cost.json"
    assert main(["prove", "cost", *AIRCRAFT, "--degree", "2", "-o", str(path)]) == 0
    return path


def changed(certificate: Path, path: Path, change: Callable[[dict[str, Any]], object]) -> Path:
    """Write a certificate with changed entries and the hashes of docs/proof.md."""
    content = json.loads(certificate.read_text())
    origin = json.dumps(content["provenance"])
    content = {name: content[name] for name in content if name not in SEALS}
    change(content)
    text = json.dumps(content)[:-1]
    for name, more in (("digest", f', "provenance": {origin}'), ("checksum", "}\n")):
        text += f', "{name}": "{hashlib.sha256(text.encode()).hexdigest()}"{more}'
    path.write_text(text)
    return path


def test_a_bound_is_proved_and_checked(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A certificate is verified by `hfa prove`.

    The first line names the weights if only the certificate contains them.
    """
    assert main(["prove", *AIRCRAFT, "--check", str(certificate)]) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "of the weights in the certificate" in out
    words = ["prove", *AIRCRAFT, "--Q", "1,1", "--R", "1", "--check", str(certificate)]
    assert main(words) == 0
    out = " ".join(capsys.readouterr().out.split())
    assert "of the weights in the certificate" not in out
    words[words.index("1,1")] = "1,2"
    assert main(words) == 1
    assert "Q in the certificate differs from the value of --Q" in capsys.readouterr().err


@pytest.mark.parametrize(
    ("name", "value", "code", "word"),
    [("kind", "sorcery", 1, "kind"), ("schema", "hfa.certificate/10", 2, "another version")],
)
def test_a_certificate_of_another_kind_is_refused(
    name: str, value: str, code: int, word: str, certificate: Path, tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:  # fmt: skip
    """A certificate of an unknown kind, or of another version, is not read."""
    path = tmp_path / "cost.json"
    changed(certificate, path, lambda content: content.update({name: value}))
    assert main(["prove", *AIRCRAFT, "--check", str(path)]) == code
    (line,) = capsys.readouterr().err.splitlines()
    assert word in line


def test_a_hidden_state_that_changes_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """`hfa prove cost` refuses the HFA.

    The derivatives of its states depend on the altitude, which the cost omits.
    """
    assert main(["prove", "cost", "--dihedral", "10"]) == 2
    assert "depend on altitude, which the cost does not include" in capsys.readouterr().err


def test_a_margin_outside_its_range_is_refused(capsys: pytest.CaptureFixture[str]) -> None:
    """A margin outside its range is refused with this range."""
    assert main(["prove", "cost", *AIRCRAFT, "--margin", "2"]) == 2
    assert "; give a number from 0.0001 to 0.99" in capsys.readouterr().err


def test_command_and_function_report_equal_bounds(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """The command and the Python function report the same bounds of the least cost."""
    words = ["optimize", *AIRCRAFT, "--start", "angle=10", "--bound", str(certificate)]
    assert main(words) == 0
    first = capsys.readouterr().out.splitlines()[0]
    assert "between 1.00 and 1.0" in first
    model = hfa.load_model(PENDULUM)
    point = hfa.trim(model)
    start = {"angle": float(np.radians(10.0))}
    best = hfa.optimize(model, point, start, bound=certificate)
    assert best.lower_bound is not None
    assert 0.9 * best.cost < best.lower_bound < best.cost
    assert f"and {best.over_bound:.2f} of" in first
    assert f"The least cost is in [{best.lower_bound:.6g}, {best.cost:.6g}]" in best.report().text()


def test_an_initial_condition_above_the_level_is_bounded(certificate: Path, tmp_path: Path) -> None:
    """Where W exceeds the level of the certificate, the lower bound of the cost is the level."""

    def first_piece(content: dict[str, Any]) -> None:
        for listed in (content["statement"]["pieces"], content["witness"]["boxes"]):
            del listed[1:]

    small = changed(certificate, tmp_path / "small.json", first_piece)
    (piece,) = json.loads(small.read_text())["statement"]["pieces"]
    model = hfa.load_model(PENDULUM)
    for degrees, is_beyond in ((1.0, False), (45.0, True)):
        start = {"angle": float(np.radians(degrees))}
        best = hfa.optimize(model, hfa.trim(model), start, bound=small)
        assert best.lower_bound is not None
        assert (best.lower_bound == piece["c"]) == is_beyond
        assert ("beyond the level" in best.report().title) == is_beyond


@pytest.mark.parametrize("limits", [(-0.5, None), (None, 0.5)])
def test_a_bound_within_narrower_limits_is_refused(
    limits: tuple[float | None, float | None],
    certificate: Path,
    tmp_path: Path,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """A bound that was proved within limits narrower on one side is refused."""

    def narrow(content: dict[str, Any]) -> None:
        content["statement"]["plant"]["limits"]["angle"] = limits

    path = changed(certificate, tmp_path / "narrow.json", narrow)
    words = ["optimize", *AIRCRAFT, "--start", "angle=10", "--bound", str(path)]
    assert main(words) == 2
    assert "limit of angle" in capsys.readouterr().err


def test_a_bound_without_a_proof_is_refused(
    certificate: Path, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """A bound whose level is raised beyond the proved one is not compared with a flight."""

    def raised(content: dict[str, Any]) -> None:
        for piece in content["statement"]["pieces"]:
            piece["c"] *= 100.0

    path = changed(certificate, tmp_path / "raised.json", raised)
    assert main(["optimize", *AIRCRAFT, "--start", "angle=10", "--bound", str(path)]) == 1
    found = capsys.readouterr()
    assert found.out == ""
    (line,) = found.err.splitlines()
    assert "not proved: the set {W <= c} extends beyond the boxes" in line


def test_a_bound_of_other_weights_is_refused(
    certificate: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`hfa optimize` refuses a bound for other weights."""
    words = ["optimize", *AIRCRAFT, "--start", "angle=10", "--Q", "1,2"]
    assert main([*words, "--bound", str(certificate)]) == 2
    assert "Q in the certificate differs from the value of --Q" in capsys.readouterr().err


DAMPED = """
from hfa import Model, Signal

def rates(x, u, p, w):
    return {"x": x.x - 30.0 * x.x**3 + u.push}, {}

push = Signal("1", 1.0, -10.0, 10.0)
DAMPED = Model("damped", {"x": Signal("", 1.0, -0.5, 0.5)}, {"push": push}, rates, trim={"x": 0.0})
"""


@pytest.mark.slow
def test_smaller_shares_are_proved_up_to_higher_levels(folder: Path) -> None:
    """Shares a of the linear cost are proved up to the level (1 + 2 a P - a² P²) / 60.

    For x' = x - 30 x³ + u, P = 1 + √2, the least of g over u is (1 + 2 a P - a² P² - 60 a P x²) x²
    for W = a P x². The highest level is that of a P near 1, five times that of a = 0.95.
    """
    (folder / "damped.py").write_text(DAMPED)
    words = ["prove", "cost", "--aircraft", "damped.py:DAMPED", "--Q", "1", "--R", "1"]
    assert main([*words, "--degree", "2", "--margin", "0.05", "-o", "damped.json"]) == 0
    pieces = json.loads((folder / "damped.json").read_text())["statement"]["pieces"]
    P = 1.0 + np.sqrt(2.0)
    for number, piece in enumerate(pieces):
        aP = piece["W"][0][0] * piece["M"][0][0] ** 2
        permitted = (1.0 + 2.0 * aP - aP**2) / 60.0
        assert 0.9 * permitted < piece["c"] < permitted or number == 0
    first = (1.0 + 1.9 * P - (0.95 * P) ** 2) / 60.0
    assert max(piece["c"] for piece in pieces) > 5.0 * first


def test_a_search_without_time_ends_with_the_limit(
    capsys: pytest.CaptureFixture[str], tmp_path: Path
) -> None:
    """A search whose time is over proves nothing, writes no file and names the time limit."""
    path = tmp_path / "none.json"
    assert main(["prove", "cost", *AIRCRAFT, "--seconds", "1e-6", "-o", str(path)]) == 1
    assert "time limit" in capsys.readouterr().err
    assert not path.exists()
