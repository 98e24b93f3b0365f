"""`hfa prove --check` compares every option of the subject with the statement."""

from dataclasses import replace
from itertools import chain
from pathlib import Path

import numpy as np
import pytest
from cli import answer, hfa

from hfa import load_model
from hfa.options.parser import options_of
from hfa_prove.commands import given
from hfa_prove.commands.check_request import CheckRequest
from hfa_prove.fields import close_to
from hfa_support.errors import NoSolutionError

ROOT = Path(__file__).resolve().parents[3]
STORED = ROOT / "tests" / "nets" / "certificates" / "schedule.json"
#: Options of the stored proof.
BASE = ("--dihedral", "15:15.25", "--dynamics", "published")
#: Entry of an option that changes no subject, and of one that a proof does not have or refuses.
SAME, REFUSED = "", "refused"
#: Field of each option -> changed options with the entry of the subject that they change.
CHANGED = {
    "aircraft": {f"--aircraft {ROOT}/examples/pendulum.py:PENDULUM": REFUSED},
    "dynamics": {"--dynamics newton": "model"},
    "parameters": {"--parameters gibson-2011-simulation": "parameters"},
    "servo": {"--servo .05": "model"},
    "isa": {"--isa 10": REFUSED},
    "mass": {"--mass 5": REFUSED},
    "at": {"--at 15.1:15.25": "range"},
    "dihedral": {"--dihedral 15:15.5": "range"},
    "condition": {"--condition few.toml": "limits", "--condition fast.toml": "imposed"},
    "free": {"--free gamma --hold throttle=0.3": "imposed"},
    "hold": {"--hold speed=70": "imposed"},
    "limit": {"--limit elevator_center=-20:20": "limits"},
    "N": {f"--N 1,0,0,0,0{';0,0,0,0,0' * 5}": "gains"},
    "delta": {"--delta 150": "gains"},
    "Q": {"--Q 1,1,1,1,1,1": "gains"},
    "R": {"--R 1,1,1,1,1": "gains"},
    "sizes": {
        "--sizes speed=10,alpha=5,pitch=5,pitch_rate=20,dihedral=5,dihedral_rate=20,throttle=40": REFUSED
    },
    "output": {"-o out.json": SAME},
    "json": {"--json": SAME},
    "quiet": {"--quiet": SAME},
    "check": {"--check other.json": REFUSED},
    "weights": {"--weights K6.npz": "gains"},
    "decay": {"--decay 0.1": SAME},
    "rate": {"--rate 1": SAME},
}
FILES = {
    "few.toml": "[limits]\nelevator_center_deg = [-20, 20]\n",
    "fast.toml": "[impose]\nspeed = 70\n",
    "other.json": "{}",
}
CASES = [(path, *each) for path, listed in CHANGED.items() for each in listed.items()]


@pytest.fixture(autouse=True)
def identity(monkeypatch):
    """Let the program be the one that made the stored certificate."""
    monkeypatch.setattr("hfa_prove.certificate.toolchain", lambda: "0.4.0")


@pytest.fixture
def files(folder):
    """Write the files that options of the table name."""
    np.savez("K6.npz", K=np.ones((5, 6)))
    for name, text in FILES.items():
        Path(name).write_text(text)


def subject(words, monkeypatch):
    """Return what a proof with these options would be about, or None if it refuses them."""
    found = []

    def search(family, gains, low, high, **_):
        found.append({**family.flight(low, high).content(), "gains": gains.content()})
        raise NoSolutionError("not searched")

    with monkeypatch.context() as replaced:
        replaced.setattr("hfa_prove.search.schedule.prove_schedule", search)
        hfa("prove", "schedule", *words)
    return found[0] if found else None


@pytest.fixture(scope="module")
def usual():
    """Return what a proof with the options of the stored one would be about."""
    with pytest.MonkeyPatch.context() as monkeypatch:
        return subject(BASE, monkeypatch)


def check_case(path, words, entry, usual, monkeypatch):
    """Fail unless options change an entry of the subject of a proof, and --check then refuses the
    stored certificate, which was made with `BASE`.

    path, words, entry: field, options and entry of `CHANGED`
    """
    flag = words.split()[0]
    other_name = {"--at": "--dihedral"}
    kept = [
        pair
        for pair in zip(BASE[::2], BASE[1::2], strict=True)
        if pair[0] not in (flag, other_name.get(flag))
    ]
    changed = (*chain.from_iterable(kept), *words.split())
    other = subject(changed, monkeypatch)
    assert usual is not None
    if other is None:
        assert entry == REFUSED
    else:
        names = [name for name in {*usual, *other} if usual.get(name) != other.get(name)]
        assert entry in names or (entry == SAME and not names)
    if path not in options_of(CheckRequest):
        return
    certificate = () if path == "check" else ("--check", str(STORED))
    found = hfa("prove", *certificate, *changed)
    assert (found.code == 0) == (entry == SAME)
    assert found.code == 0 or (found.out == "" and len(found.err.splitlines()) == 1)


@pytest.mark.parametrize("size", [1e-9, 1.0, 1e12])
def test_gains_are_compared_in_any_units(size):
    """A gain that differs by 1 % in one entry is another gain, whatever the unit of the rate: entries are
    compared in nominal values of the states, here `size` for the rate.
    """
    pendulum = load_model(f"{ROOT}/examples/pendulum.py:PENDULUM")
    states = dict(pendulum.states)
    states["rate"] = states["rate"]._replace(nominal=size)
    model = replace(pendulum, states=states)
    same = close_to(given.SAME_GAIN, given.sizes_of_gain(model))
    gain = np.array([[2.0, 1.5 / size]])
    assert same((gain * (1.0 + 1e-10)).tolist(), gain)
    for factor in ([1.0, 1.01], [1.01, 1.0], [1.0, 0.99]):
        assert not same((gain * factor).tolist(), gain)


def test_the_options_of_the_proof_give_the_subject():
    """With the options of its proof, a certificate is verified; what is not given is named."""
    assert answer("prove", "--check", str(STORED), *BASE)["not_given"] == ["gains"]


@pytest.mark.parametrize(("path", "words", "entry"), CASES)
def test_a_changed_option_is_refused_if_it_changes_the_subject(
    path, words, entry, usual, files, monkeypatch
):
    """If an option of `BASE` is changed as in `CHANGED`, the listed entry of what a proof is about changes,
    and --check refuses the stored certificate. Without a listed entry, the certificate is verified.
    """
    check_case(path, words, entry, usual, monkeypatch)


@pytest.mark.parametrize(
    ("typed", "said"),
    [
        ((), ""),
        (("--rate",), "moves at any rate"),
        (("--rate", "1"), "moves at up to 1 deg/s"),
    ],
)
def test_the_asked_rate_is_the_claim_of_a_certificate_that_is_checked(typed, said, folder):
    """Without --rate, the claim has no motion, with it alone the largest found, here any, and with a
    number this one. The check accepts the written certificate for its interval, and for no longer one.
    """
    words = ("prove", "schedule", "--dihedral", "15:15.001", "-q", *typed, "-o", "c.json")
    shown = " ".join(hfa(*words).out.split())
    assert said in shown
    assert ("dihedral moves" in shown) == bool(said)
    check = ("prove", "--check", "c.json", "--dihedral")
    checked = " ".join(hfa(*check, "15:15.001").out.split())
    assert said in checked
    assert "parameters identified (" in checked
    assert hfa(*check, "15:15.002").code == 1
