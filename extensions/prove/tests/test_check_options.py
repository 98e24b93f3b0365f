"""`hfa prove --check` compares every option of the subject with the statement."""

from __future__ import annotations

import re
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa

from hfa.main import BAD_INPUT, FAILED

ROOT = Path(__file__).resolve().parents[3]
PENDULUM = ("--aircraft", f"{ROOT}/examples/pendulum.py:PENDULUM")
#: Kind of a certificate -> options of its proof, and options that give the whole subject.
PROOFS = {
    "region": (
        (*PENDULUM, "--degree", "2", "--seconds", "4", "--R", "2", "--limit", "torque=-0.6:0.6"),
        (*PENDULUM, "--R", "2", "--limit", "torque=-0.6:0.6"),
    ),
    "schedule": (("--dihedral", "14:14.25"), ("--dihedral", "14:14.25", "--dynamics", "published")),
}
#: Options that change the subject: kind, the quantity that differs or the reason, words.
CHANGED = [
    *(("region", "K", (f"--{name}", word)) for name, word in (
        ("N", "0;0.1"), ("Q", "1,2"), ("R", "3"), ("delta", "20"), ("weights", "K.npz"),
    )),
    ("region", "K", ("--weights", "W.npz", "--basis", "x1**2, x1*x2, x2**2, x2**4")),
    ("region", "--network applies to a policy in a file", ("--network", "policy=")),
    ("region", "--set applies to a policy in a file", ("--set", "scale=1,2")),
    ("region", "the table [policy] is missing", ("--policy", "policy.toml")),
    ("region", "push", ("--disturbance", "push=0.1")),
    ("region", "limit of torque", ("--limit", "torque=-0.6:0.5")),
    ("region", "angle", ("--hold", "angle=0.1")),
    ("region", "angle", ("--free", "angle", "--hold", "torque=0.1")),
    ("region", "other equations", ("--aircraft", f"{ROOT}/examples/pendulum.py:VAN_DER_POL")),
    ("region", "takes no mass", ("--mass", "5")),
    ("schedule", "range", ("--dihedral", "14:14.5")),
    ("schedule", "limit of elevator_center", ("--limit", "elevator_center=-20:20")),
    ("schedule", "speed", ("--hold", "speed=70")),
    ("schedule", "dynamics", ("--dynamics", "newton")),
    ("schedule", "panel_mass", ("--parameters", "gibson-2011-simulation")),
    ("schedule", "breakpoints", ("--weights", "K6.npz")),
    *(("schedule", "K", (f"--{name}", word)) for name, word in (
        ("Q", "1,1,1,1,1,1"), ("R", "1,1,1,1,1"), ("delta", "150"), ("N", ";".join(["1,0,0,0,0", *["0,0,0,0,0"] * 5])),
    )),
]  # fmt: skip
#: Options that do not change the subject: the search for the trim, and the run itself.
OTHERS = {"--check", "--quiet", "--json", "--output", "--start", "--condition", "--help", "--at"}


@pytest.fixture(scope="module")
def certificates(tmp_path_factory: pytest.TempPathFactory) -> Path:
    folder = tmp_path_factory.mktemp("certificates")
    for kind, (words, _) in PROOFS.items():
        assert hfa("prove", kind, *words, "-o", str(folder / f"{kind}.json")).code == 0
    return folder


@pytest.mark.parametrize("kind", PROOFS)
def test_the_options_of_the_proof_give_the_subject(kind: str, certificates: Path) -> None:
    """With the subject of the proof, a certificate is verified; a part that is not given is named."""
    found = answer("prove", "--check", str(certificates / f"{kind}.json"), *PROOFS[kind][1])
    assert found["kind"] == kind
    assert found["not_given"] == (["gains"] if kind == "schedule" else [])


@pytest.mark.parametrize(("kind", "named", "words"), CHANGED)
def test_an_option_that_changes_the_subject_is_refused(
    kind: str, named: str, words: tuple[str, ...], certificates: Path, folder: Path
) -> None:
    """Each option that differs from the proof, or does not apply, is named in one line."""
    np.savez("K.npz", K=[[2.0, 1.5]])
    np.savez("W.npz", W=[1.0, 2.0, 3.0, 0.5])
    np.savez("K6.npz", K=np.ones((5, 6)))
    Path("policy.toml").write_text("")
    subject: tuple[str, ...] = PENDULUM if kind != "schedule" else ()
    if "--aircraft" in words:
        subject = ()
    elif kind == "region" and "--limit" not in words:
        subject = (*PENDULUM, "--limit", "torque=-0.6:0.6")
    found = hfa("prove", "--check", str(certificates / f"{kind}.json"), *subject, *words)
    (line,) = found.err.splitlines()
    assert found.out == ""
    if found.code == BAD_INPUT:
        assert named in line
    else:
        assert found.code == FAILED
        assert line.startswith(f"hfa: {named} in the certificate differs from the value of --")
        assert words[0] in line


def test_limits_bind_in_the_loop(certificates: Path) -> None:
    """The limits of an input that the trim imposes are those where the loop is saturated."""
    words = ("prove", "--check", str(certificates / "region.json"), *PENDULUM, "--R", "2")
    stated = answer(*words, "--limit", "torque=-0.6:0.6")["claim"]["loop"]["limits"]
    assert stated["torque"] == [-0.6, 0.6]
    assert hfa(*words).code == 1  # the model's limits are wider


def test_no_option_is_left_out() -> None:
    """The table above has every option of the help, so that a new one is compared."""
    listed = set(re.findall(r"(?m)^ +(?:-\w,? )?(--[\w-]+)", hfa("prove", "--help", "more").out))
    given = {word for _, _, words in CHANGED for word in words if word.startswith("--")}
    assert len(listed) > 15
    assert listed - OTHERS == given - {"--dihedral"}
