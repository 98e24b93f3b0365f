"""`hfa prove --check` compares every option of the subject with the statement."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import chain
from pathlib import Path
from typing import Any, NamedTuple

import numpy as np
import pytest
from cli import answer, hfa

from hfa import load_model
from hfa.options.option import options_of
from hfa_prove.commands import given
from hfa_prove.commands.request import CheckRequest, RegionRequest
from hfa_prove.commands.schedule import ScheduleRequest
from hfa_prove.statements.loop import SAME_GAIN
from hfa_prove.subject import close_to
from hfa_support.errors import NoSolutionError

ROOT = Path(__file__).resolve().parents[3]
STORED = ROOT / "tests" / "nets" / "certificates"
PENDULUM = ("--aircraft", f"{ROOT}/examples/pendulum.py:PENDULUM")
VAN_DER_POL = ("--aircraft", f"{ROOT}/examples/pendulum.py:VAN_DER_POL")
LEVEL = ("--dihedral", "15:15.25", "--dynamics", "published")


class Proof(NamedTuple):
    """A kind of proof: its request, the function that searches it, and options of the stored one."""

    request: Any
    search: str
    words: tuple[str, ...]


PROOFS = {
    "region": Proof(RegionRequest, "hfa_prove.search.region.proved_region", PENDULUM),
    "schedule": Proof(ScheduleRequest, "hfa_prove.search.schedule.prove_schedule", LEVEL),
}
#: Entry of an option that changes no subject, and of one that a proof does not have or refuses.
SAME, REFUSED = "", "refused"
#: Field of each option -> changed options with the entry of the subject that they change, for regions
#: and for schedules.
CHANGED: dict[str, tuple[dict[str, str], dict[str, str]]] = {
    "aircraft": ({" ".join(VAN_DER_POL): "model"}, {" ".join(PENDULUM): REFUSED}),
    "dynamics": ({"--dynamics newton": REFUSED}, {"--dynamics newton": "model"}),
    "parameters": (
        {"--parameters gibson-2011-simulation": REFUSED},
        {"--parameters gibson-2011-simulation": "parameters"},
    ),
    "isa": ({"--isa 10": REFUSED}, {"--isa 10": REFUSED}),
    "mass": ({"--mass 5": REFUSED}, {"--mass 5": REFUSED}),
    "at": ({"--at 10": REFUSED}, {"--at 15.1:15.25": "range"}),
    "dihedral": ({"--dihedral 10": REFUSED}, {"--dihedral 15:15.5": "range"}),
    "condition": (
        {"--condition narrow.toml": "limits", "--condition tilted.toml": "trim"},
        {"--condition few.toml": "limits", "--condition fast.toml": "imposed"},
    ),
    "free": (
        {"--free angle --hold torque=0.1": "trim"},
        {"--free gamma --hold throttle=0.3": "imposed"},
    ),
    "hold": ({"--hold angle=0.1": "trim"}, {"--hold speed=70": "imposed"}),
    "limit": (
        {"--limit torque=-0.6:0.7": "limits", "--limit angle=-90:90": "limits"},
        {"--limit elevator_center=-20:20": "limits"},
    ),
    "start": (
        {"--start angle=5": SAME},
        {"--start speed=60": REFUSED},
    ),
    "N": ({"--N 0;0.1": "policy"}, {f"--N 1,0,0,0,0{';0,0,0,0,0' * 5}": "gains"}),
    "delta": ({"--delta 20": "policy"}, {"--delta 150": "gains"}),
    "Q": ({"--Q 1,2": "policy"}, {"--Q 1,1,1,1,1,1": "gains"}),
    "R": ({"--R 3": "policy"}, {"--R 1,1,1,1,1": "gains"}),
    "basis": (
        {"--weights W.npz --basis x1**2,x1*x2,x2**2,x2**4": "policy"},
        {"--basis quartic": REFUSED},
    ),
    "network": ({"--network policy=": REFUSED}, {"--network policy=": REFUSED}),
    "set": ({"--set scale=1,2": REFUSED}, {"--set scale=1,2": REFUSED}),
    "output": ({"-o out.json": SAME}, {"-o out.json": SAME}),
    "json": ({"--json": SAME}, {"--json": SAME}),
    "quiet": ({"--quiet": SAME}, {"--quiet": SAME}),
    "check": (
        {f"--check {STORED}/region_disturbed.json": REFUSED},
        {f"--check {STORED}/region.json": REFUSED},
    ),
    "weights": ({"--weights K.npz": "policy"}, {"--weights K6.npz": "gains"}),
    "policy": ({"--policy policy.toml": REFUSED}, {"--policy policy.toml": REFUSED}),
    "disturbance": ({"--disturbance push=0.1": "disturbances"}, {"--disturbance a=1": REFUSED}),
    "degree": ({"--degree 2": SAME}, {"--degree 2": REFUSED}),
    "seconds": ({"--seconds 1": SAME}, {"--seconds 1": REFUSED}),
    "decay": ({"--decay 0.1": REFUSED}, {"--decay 0.1": SAME}),
    "rate": ({"--rate 1": REFUSED}, {"--rate 1": SAME}),
}
FILES = {
    "narrow.toml": "[limits]\ntorque = [-0.5, 0.5]\n",
    "tilted.toml": "[impose]\nangle = 0.1\n",
    "few.toml": "[limits]\nelevator_center_deg = [-20, 20]\n",
    "fast.toml": "[impose]\nspeed = 70\n",
    "policy.toml": "",
}
CASES = [
    (kind, path, words, entry)
    for path, by_kind in CHANGED.items()
    for kind, listed in zip(PROOFS, by_kind, strict=True)
    for words, entry in listed.items()
]


@pytest.fixture
def files(folder: Path) -> None:
    np.savez("K.npz", K=[[2.0, 1.5]])
    np.savez("W.npz", W=[1.0, 2.0, 3.0, 0.5])
    np.savez("K6.npz", K=np.ones((5, 6)))
    for name, text in FILES.items():
        Path(name).write_text(text)


def subject(
    kind: str, words: tuple[str, ...], monkeypatch: pytest.MonkeyPatch
) -> dict[str, Any] | None:
    """Return what a proof with these options would be about, or None if it refuses them."""
    found: list[dict[str, Any]] = []

    def search(about: Any, *gains: Any, **_: Any) -> None:
        if kind == "region":
            found.append(about.loop.content())
        else:
            schedule, low, high = gains
            found.append({**about.flight(low, high).content(), "gains": schedule.content()})
        raise NoSolutionError("not searched")

    with monkeypatch.context() as replaced:
        replaced.setattr(PROOFS[kind].search, search)
        hfa("prove", kind, *words)
    return found[0] if found else None


def check_case(
    kind: str, path: str, words: str, entry: str, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Fail unless the options change the entry in a proof, and --check then complains."""
    base = PROOFS[kind].words
    flag = words.split()[0]
    other_name = {"--at": "--dihedral"}
    kept = [
        pair
        for pair in zip(base[::2], base[1::2], strict=True)
        if pair[0] not in (flag, other_name.get(flag))
    ]
    changed = (*chain.from_iterable(kept), *words.split())
    usual, other = (subject(kind, each, monkeypatch) for each in (base, changed))
    assert usual is not None
    if other is None:
        assert entry == REFUSED
    else:
        names = [name for name in {*usual, *other} if usual.get(name) != other.get(name)]
        assert entry in names or (entry == SAME and not names)
    if path not in options_of(CheckRequest):
        return
    certificate = () if path == "check" else ("--check", f"{STORED}/{kind}.json")
    found = hfa("prove", *certificate, *changed)
    if path == "check" and kind == "region":
        assert "every |push| <= 0.1 N m" in " ".join(found.out.split())
    else:
        assert (found.code == 0) == (entry == SAME)
    assert found.code == 0 or (found.out == "" and len(found.err.splitlines()) == 1)


@pytest.mark.parametrize("size", [1e-9, 1.0, math.degrees(1.0), 1e12])
def test_gains_are_compared_in_any_units(size: float) -> None:
    """A gain of the rate that is 1 % off is another gain, also if all gains of the rate are tiny."""
    pendulum = load_model(PENDULUM[1])
    states = dict(pendulum.states)
    states["rate"] = states["rate"]._replace(nominal=size)
    model = replace(pendulum, states=states)
    same = close_to(SAME_GAIN, given.sizes_of_gain(model))
    gain = np.array([[2.0, 1.5 / size]])
    assert same((gain * (1.0 + 1e-10)).tolist(), gain)
    assert not same((gain * [1.0, 1.01]).tolist(), gain)
    assert not same((gain * [1.01, 1.0]).tolist(), gain)
    terms = {"torque": [[2.0, [3, 0]], [1.5 / size**3, [0, 3]]]}
    assert given.same_terms(model)(terms, terms)
    other = {"torque": [[2.0, [3, 0]], [1.515 / size**3, [0, 3]]]}
    assert not given.same_terms(model)(other, terms)


def test_every_option_is_changed() -> None:
    """The table has each option of the proofs and of --check for both kinds, and no other."""
    listed = {path for proof in PROOFS.values() for path in options_of(proof.request)}
    assert listed | set(options_of(CheckRequest)) == set(CHANGED)
    assert all(all(by_kind) for by_kind in CHANGED.values())


@pytest.mark.parametrize("kind", PROOFS)
def test_the_options_of_the_proof_give_the_subject(kind: str) -> None:
    """With the options of its proof, a certificate is verified; what is not given is named."""
    found = answer("prove", "--check", f"{STORED}/{kind}.json", *PROOFS[kind].words)
    assert found["kind"] == kind
    assert found["not_given"] == [{"region": "policy", "schedule": "gains"}[kind]]


@pytest.mark.parametrize(("kind", "path", "words", "entry"), CASES)
def test_an_option_that_changes_the_subject_is_noticed(
    kind: str, path: str, words: str, entry: str, files: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Each option that changes what a proof is about is compared with the certificate."""
    check_case(kind, path, words, entry, monkeypatch)


@pytest.mark.parametrize(
    ("entry", "path"),
    [("limits", "limit"), ("limits", "condition"), ("policy.K", "R")],
)
def test_an_option_that_is_not_compared_is_found(
    entry: str, path: str, files: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    """The test above fails if the comparison leaves out an entry."""
    compared = given.given_for

    def forgetful(*arguments: Any) -> Any:
        return {
            name: value for name, value in compared(*arguments).items() if name != f"loop.{entry}"
        }

    monkeypatch.setattr(given, "given_for", forgetful)
    words, changed = next(iter(CHANGED[path][0].items()))
    with pytest.raises(AssertionError):
        check_case("region", path, words, changed, monkeypatch)
