"""Each changed field of a statement is refused, or printed in the report."""

from __future__ import annotations

import copy
from contextlib import suppress
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from as_proved import as_proved
from proof_cases import PLANT, certificate, forge, model_of

import hfa
from hfa import BadInputError
from hfa_prove.certificate import read_statement
from hfa_prove.check import check_certificate
from hfa_prove.commands.check import check
from hfa_prove.commands.given import given_for
from hfa_prove.commands.request import CheckRequest
from hfa_prove.fields import Malformed, Stated, entry
from hfa_prove.report import checked_report
from hfa_prove.statements import game
from hfa_prove.statements.flight import Flight
from hfa_prove.statements.game import GameStatement, Weights
from hfa_prove.statements.plant import Subject
from hfa_prove.statements.schedule import (
    Controller,
    FixedActuators,
    ScheduleStatement,
    UncertainActuators,
)
from hfa_prove.subject import Given, compare, within
from hfa_support.errors import NoSolutionError

#: A certificate of each form that a statement may have.
CASES = ("rate", "second order", "actuators", "critic", "plant")


def changed(value: Any) -> Any:
    """Return an entry of a statement with its first number or string changed."""
    if isinstance(value, dict):
        if not value:
            return {"x": 1.0}
        first = next(iter(value))
        return value | {first: changed(value[first])}
    if isinstance(value, list):
        return [changed(value[0]), *value[1:]] if value else [1.0]
    if isinstance(value, bool):
        return not value
    return f"{value}x" if isinstance(value, str) else value * 1.01 + 0.01


def with_changed(content: Any, path: str) -> Any:
    made = copy.deepcopy(content)
    *parents, last = path.split(".")
    holder = made
    for name in parents:
        holder = holder[name]
    holder[last] = changed(holder[last])
    return made


def request_for(kind: str, folder: Path) -> CheckRequest:
    """Return a request with all options that apply to the certificate of this kind."""
    statement = certificate(kind)["statement"]
    weights = folder / "weights.npz"
    options: dict[str, Any] = {"weights": weights}
    if kind == "plant":
        plant = folder / "plant.npz"
        np.savez(plant, **{name: getattr(PLANT, name) for name in ("A", "B", "E", "Q", "R")})
        options |= {"game.plant": plant, "game.weights.delta": PLANT.delta}
    else:
        options["aircraft.dynamics"] = "published"
        flight = statement.get("flight") or statement["plant"]
        options["trim.at"] = tuple(dict.fromkeys(flight["range"]))
    if kind in ("plant", "critic"):
        np.savez(weights, **{name: np.array(part) for name, part in statement["critic"].items()})
    else:
        controller = statement["controller"]
        np.savez(weights, dihedral_deg=controller["breakpoints"], K=-np.array(controller["D"]))
    if kind == "critic":
        stated = {name: np.array(statement["weights"][name]) for name in "QR"} | {"delta": 200.0}
        options |= {f"game.weights.{name}": value for name, value in stated.items()}
    if kind == "second order":  # a controller with states has no gain to give
        del options["weights"]
    return CheckRequest.parsed(hfa.aircraft(), options)


def text_of(kind: str, content: Any) -> str:
    """Return the text of the report on a statement, without the line of its digest."""
    statement = read_statement(certificate(kind)["kind"], content, Subject(model_of(kind)))
    lines = checked_report(as_proved(statement)).text().splitlines()
    return "\n".join(line for line in lines if not line.startswith("statement: SHA-256"))


@pytest.mark.parametrize("kind", CASES)
def test_each_field_is_compared_or_printed(kind: str, tmp_path: Path) -> None:
    """Each field of a statement is compared with the user's value or changes the printed report."""
    made = certificate(kind)
    content = made["statement"]
    statement = read_statement(made["kind"], content, Subject(model_of(kind)))
    given = given_for(statement, request_for(kind, tmp_path))
    compare(statement, given)
    original = text_of(kind, content)
    for path, declared, _ in statement.entries():
        other = with_changed(content, path)
        with suppress(Malformed, BadInputError):  # refused for all options
            changed = read_statement(made["kind"], copy.deepcopy(other), Subject(model_of(kind)))
            if path in given:
                with pytest.raises(
                    NoSolutionError, match="in the certificate differs from the value of"
                ):
                    compare(changed, given)
            if declared.shown:
                assert text_of(kind, other) != original, path
        assert path in given or declared.shown, path


def test_the_test_certificates_contain_every_field() -> None:
    """The certificates of these tests contain every entry of statements on schedules and games."""

    def declared(kind: Any) -> set[str]:
        return {f"{kind.__name__}.{each.name}" for each in fields(kind)}

    def held(value: Any) -> set[str]:
        if not isinstance(value, Stated):
            return set()
        found = set[str]()
        for each in fields(value):  # type: ignore[arg-type]
            entry = getattr(value, each.name)
            if entry is not None:
                found |= {f"{type(value).__name__}.{each.name}"} | held(entry)
        return found

    kinds = (
        *(ScheduleStatement, Controller, FixedActuators, UncertainActuators, Flight),
        *(GameStatement, game.Plant, Weights),
    )
    wanted = set[str]().union(*(declared(kind) for kind in kinds))
    certificates = [certificate(case) for case in (*CASES, "solution")]
    statements = [read_statement(made["kind"], made["statement"]) for made in certificates]
    assert set[str]().union(*(held(statement) for statement in statements)) == wanted


@dataclass(frozen=True, eq=False)
class _Claim(Stated):
    A: Any = entry(lambda file, name, known: None, subject="plant")
    K: Any = entry(lambda file, name, known: None, subject="gain")
    rho: float = entry(lambda file, name, known: None)


def test_missing_subjects_are_named() -> None:
    """The comparison returns the names of values that the user did not give, and refuses values
    that differ.
    """
    claim = _Claim([[1.0]], [[2.0]], 3.0)
    assert compare(claim, {}) == ["plant", "gain"]
    assert compare(claim, {"K": Given([[2.0]], "--weights")}) == ["plant"]
    with pytest.raises(
        NoSolutionError, match="K in the certificate differs from the value of --weights"
    ):
        compare(claim, {"K": Given([[2.0, 0.0]], "--weights")})
    with pytest.raises(BadInputError, match="does not contain"):
        compare(claim, {"P": Given([[2.0]], "--weights")})


def test_the_error_ignores_tolerated_differences() -> None:
    """The error names the state whose trim differs by more than the tolerance, not the first
    state.
    """
    stated = _Claim({"alpha": 0.1, "speed": 50.0, "altitude": 3.0}, None, 0.0)
    own = Given(
        {"alpha": 0.1 + 1e-9, "speed": 60.0}, "--at", within({"alpha": 1e-6, "speed": 1e-3})
    )
    with pytest.raises(NoSolutionError, match="speed in the certificate differs from the value"):
        compare(stated, {"A": own})
    with pytest.raises(NoSolutionError, match="A in the certificate differs"):
        compare(stated, {"A": Given("a digest", "--weights")})
    missing = own._replace(value={"alpha": 0.1, "speed": 50.0})
    with pytest.raises(NoSolutionError, match="altitude in the certificate differs"):
        compare(stated, {"A": missing})


def test_options_of_another_kind_are_refused(tmp_path: Path) -> None:
    """Options that do not apply to the certificate are refused, not ignored.

    Examples are an aircraft for a plant's certificate, a plant for an aircraft's certificate, and a
    design without its controller.
    """
    model = hfa.aircraft()
    for kind, options in (
        ("plant", {"aircraft.dynamics": "published"}),
        ("plant", {"trim.at": (14.0,)}),
        ("rate", {"game.plant": tmp_path / "plant.npz"}),
        ("rate", {"design": "paper"}),
        ("rate", {"set": {"scale": 1.0}}),
        ("critic", {"design": "paper"}),
        ("critic", {"reading.basis": "quadratic"}),
    ):
        request = CheckRequest.parsed(model, options)
        path = forge(tmp_path / f"{kind}.json", certificate(kind))
        with pytest.raises(BadInputError):
            check(request, path, certificate(kind)["kind"])
    with pytest.raises(BadInputError, match="not the certificate of a region"):
        check(request, path, "region")


def test_a_value_of_another_gain_is_refused(tmp_path: Path) -> None:
    """A file with W alone is refused for a statement whose K is not the gain of W.

    A certificate that claims that K is the gain of W is refused too.
    """
    made = certificate("plant")
    statement = read_statement(made["kind"], made["statement"])
    assert not statement.gain_of_value
    weights = tmp_path / "weights.npz"
    np.savez(weights, W=np.array(made["statement"]["critic"]["W"])[:, 0])
    request = CheckRequest.parsed(hfa.aircraft(), {"weights": weights})
    with pytest.raises(NoSolutionError, match="K is not the gain of the certificate's P or W"):
        given_for(statement, request)
    claimed = copy.deepcopy(made)
    claimed["statement"]["gain_of_value"] = True
    with pytest.raises(NoSolutionError, match="K is not the gain"):
        check_certificate(forge(tmp_path / "claimed.json", claimed))


def test_a_value_of_a_file_is_compared_in_the_form_of_the_certificate(tmp_path: Path) -> None:
    """P of a file is compared as it is; W stands for P only if the certificate alone has P."""
    made = certificate("plant")
    original = read_statement(made["kind"], made["statement"])
    K = original.critic["K"]
    W = np.array([1.0, 2.0, 3.0])
    P = np.array([[9.0, 1.0], [1.0, 8.0]])
    weights = tmp_path / "weights.npz"
    for stated in (("W", "K"), ("W", "P", "K")):
        critic = {"W": W[:, None], "P": P, "K": K}
        statement = replace(original, critic={name: critic[name] for name in stated})
        for parts in ({"W": W, "K": K}, {"W": W, "P": P, "K": K}):
            np.savez(weights, **parts)
            given = given_for(statement, CheckRequest.parsed(hfa.aircraft(), {"weights": weights}))
            assert ("critic.P" in given) is ("P" in stated or "P" in parts)
            if "critic.P" in given:
                own = P if "P" in parts else [[1.0, 1.0], [1.0, 3.0]]
                assert np.allclose(given["critic.P"].value, own)
            assert np.array_equal(given["critic.W"].value, W[:, None])
