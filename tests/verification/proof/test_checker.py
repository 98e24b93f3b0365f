"""The checker: what the prover made passes, what was changed does not, and the two share nothing."""

from __future__ import annotations

import json
from collections.abc import Callable
from pathlib import Path
from typing import Any

import casadi as ca
import flint
import numpy as np
import pytest
from flint import arb
from import_graph import project_sources, reachable
from proof_cases import exact_table, family, model_at

from hfa_model.aircraft import compiled_dynamics
from hfa_model.support.errors import BadInputError
from hfa_model.variants import VARIANTS
from verification.proof import certificate_file
from verification.proof.certificate_file import Certificate, digest
from verification.proof.checker import check_certificate
from verification.proof.schedule_proof import prove_schedule
from verification.proof.taylor_model import Rejected, TaylorModel, as_model, evaluate

Content = dict[str, Any]


@pytest.fixture(scope="module")
def proved(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The certificate of 14 to 15 deg."""
    path = tmp_path_factory.mktemp("proof") / "certificate.json"
    flights, table = family(), exact_table(14.0, 15.0)
    file = Certificate(flights, table, 14.0, 15.0, path)
    found = prove_schedule(flights, table, 14.0, 15.0)
    file.save(found.loop, found.modes, finished=True)
    assert [one.counts for one in file.known()] == [found.loop.counts, found.modes.counts]
    return path


def test_what_was_proved_is_verified(proved: Path) -> None:
    found = check_certificate(proved)
    assert found.proved
    assert (found.low, found.high) == (14.0, 15.0)
    assert found.loop == [(14.0, 15.0, 0)]
    assert found.modes == [(14.0, 15.0, 2)]
    assert 0.29 < found.rate < 0.36


def test_one_edited_digit_is_refused(proved: Path, tmp_path: Path) -> None:
    text = proved.read_text()
    random = np.random.default_rng(0)
    digits = [place for place, letter in enumerate(text) if letter in "123456789"]
    for place in random.choice(digits, 20):
        other = "2" if text[place] == "1" else "1"
        edited = tmp_path / "edited.json"
        edited.write_text(text[:place] + other + text[place + 1 :])
        with pytest.raises(BadInputError, match=r"refused, the certificate was edited|is no certificate"):
            check_certificate(edited)


def _rate(content: Content) -> None:
    content["loop"][0]["rate"] = 0.5


def _negative_rate(content: Content) -> None:
    content["loop"][0]["rate"] = -0.1


def _sign(content: Content) -> None:
    content["loop"][0]["H"] = (-np.array(content["loop"][0]["H"])).tolist()


def _count(content: Content) -> None:
    content["modes"][0]["unstable"] = 0


def _gain(content: Content) -> None:
    content["statement"]["table"]["K"][0] = np.zeros((5, 6)).tolist()


def _entry(content: Content) -> None:
    ends = content["loop"][0]["A"][3][1]
    ends[1] = (ends[0] + ends[1]) / 2


def _trim(content: Content) -> None:
    content["loop"][0]["trim"][0][0] += 1e-3


def _dynamics(content: Content) -> None:
    content["statement"]["dynamics"] = "newton"


def _order(content: Content) -> None:
    content["modes"].insert(0, content["modes"][-1])


def _across(content: Content) -> None:
    content["statement"]["table"]["dihedral_deg"] = [14.0, 14.2]


def _singular(content: Content) -> None:
    content["loop"][0]["H"] = np.diag([1.0, 1.0, 1.0, 1.0, 1.0, 0.0]).tolist()


def _missing(content: Content) -> None:
    del content["loop"][0]["H"]


@pytest.mark.parametrize(
    "change",
    [_rate, _negative_rate, _sign, _count, _gain, _entry, _trim, _dynamics, _order, _across, _singular, _missing],
)
def test_a_forged_certificate_with_a_right_digest_is_rejected(
    proved: Path, tmp_path: Path, change: Callable[[Content], None]
) -> None:
    content = json.loads(proved.read_text())
    change(content)
    forged = tmp_path / "forged.json"
    forged.write_text(json.dumps(content | {"digest": digest(content)}))
    with pytest.raises(Rejected):
        check_certificate(forged)


def test_an_interrupted_proof_is_continued(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(certificate_file, "_PAUSE", 0.0)
    path, flights, table = tmp_path / "certificate.json", family(), exact_table(14.0, 15.0)

    def interrupted(done: int, total: int) -> None:
        if done > 0.6 * total:
            raise KeyboardInterrupt

    file = Certificate(flights, table, 14.0, 15.0, path)
    with pytest.raises(KeyboardInterrupt):
        prove_schedule(flights, table, 14.0, 15.0, save=file.save, progress=interrupted)
    assert check_certificate(path).modes != [(14.0, 15.0, 2)]
    found = prove_schedule(flights, table, 14.0, 15.0, known=file.known(), save=file.save)
    assert found.proved
    assert check_certificate(path).modes == [(14.0, 15.0, 2)]


def test_a_missing_box_is_not_proved(proved: Path, tmp_path: Path) -> None:
    content = json.loads(proved.read_text())
    content["loop"].pop()
    short = tmp_path / "short.json"
    short.write_text(json.dumps(content | {"digest": digest(content)}))
    assert not check_certificate(short).proved


@pytest.mark.parametrize("text", ["", "[]", "{}", '{"schema": "other", "digest": "0"}'])
def test_what_is_no_certificate_is_said(tmp_path: Path, text: str) -> None:
    path = tmp_path / "other.json"
    path.write_text(text)
    with pytest.raises(BadInputError):
        check_certificate(path)


def test_the_checker_shares_nothing_with_the_prover() -> None:
    used = reachable("verification.proof.checker", project_sources())
    rooms = {"verification", "verification.proof"}
    ours = {name for name in used if name.startswith("verification")} - rooms
    assert ours == {"verification.proof.checker", "verification.proof.taylor_model"}


@pytest.mark.parametrize("dynamics", VARIANTS)
def test_taylor_models_hold_the_function_along_the_box(dynamics: str) -> None:
    """f(x + s d) of the model lies in the Taylor model of f, at random s; the rest is of third order."""
    flint.ctx.prec = 106
    function = compiled_dynamics(VARIANTS[dynamics]).rates
    point, parameters = model_at(12.0, dynamics).point, family(dynamics).aircraft.parameters
    random = np.random.default_rng(3)
    x, direction = np.array(point.states), random.uniform(-1.0, 1.0, 7) * [5.0, 0.1, 0.0, 0.1, 0.1, 0.1, 0.1]
    fixed = [[arb(value) for value in values] for values in (point.inputs, parameters)]
    rests = []
    for size in (0.2, 0.1):
        steps = [arb(entry) * arb(size) for entry in direction.tolist()]
        along = [TaylorModel(a, b) for a, b in zip(x.tolist(), steps, strict=True)]
        along[2] = arb(x[2])
        models = [as_model(each) for each in evaluate(function, along, *fixed)[0]]
        for s in random.uniform(-1.0, 1.0, 10).tolist():
            values = evaluate(function, [arb(a) + b * s for a, b in zip(x.tolist(), steps, strict=True)], *fixed)[0]
            for model, value in zip(models, values, strict=True):
                assert (model.c0 + model.c1 * s + model.c2 * (arb(s) ** 2) + model.rest).overlaps(value)
        rests.append(max(float(model.rest.rad()) for model in models))
    assert 6.0 < rests[0] / rests[1] < 12.0


def test_an_unknown_operation_is_not_passed_over() -> None:
    x = ca.SX.sym("x")
    with pytest.raises(KeyError):
        evaluate(ca.Function("f", [x], [ca.erf(x)]), [arb(1)])
