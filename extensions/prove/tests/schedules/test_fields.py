"""Each changed field of a statement is refused, or printed in the report."""

from __future__ import annotations

import copy
from contextlib import suppress
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
from hfa_prove.commands.given import given_for
from hfa_prove.commands.request import CheckRequest
from hfa_prove.fields import FIELDS, Field, Malformed
from hfa_prove.report import checked_report
from hfa_prove.statements.plant import Subject
from hfa_prove.subject import Given, compare, entries_of, within
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
    options: dict[str, Any] = {"model": hfa.aircraft(), "weights": weights}
    if kind == "plant":
        plant = folder / "plant.npz"
        np.savez(plant, **{name: getattr(PLANT, name) for name in ("A", "B", "E", "Q", "R")})
        options |= {"plant": plant, "delta": PLANT.delta}
    else:
        options["dynamics"] = "published"
        options["at"] = tuple(dict.fromkeys(statement["flight"]["range"]))
    if kind in ("plant", "critic"):
        np.savez(weights, **{name: np.array(part) for name, part in statement["critic"].items()})
    else:
        controller = statement["controller"]
        np.savez(weights, dihedral_deg=controller["breakpoints"], K=-np.array(controller["D"]))
    if kind == "critic":
        options |= {"delta": 200.0} | {name: np.array(statement["weights"][name]) for name in "QR"}
    if kind == "second order":  # a controller with states has no gain to give
        del options["weights"]
    return CheckRequest(**options, typed=frozenset(options))


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
    table = FIELDS[made["kind"]]
    statement = read_statement(made["kind"], content, Subject(model_of(kind)))
    given = given_for(statement, request_for(kind, tmp_path))
    compare(content, table, given)
    original = text_of(kind, content)
    for path, _ in entries_of(content, table):
        other = with_changed(content, path)
        if path in given:
            with pytest.raises(
                NoSolutionError, match="in the certificate differs from the value of"
            ):
                compare(other, table, given)
        if table[path].shown:
            with suppress(Malformed, BadInputError):  # refused for all options
                assert text_of(kind, other) != original, path
        assert path in given or table[path].shown, path


def test_the_test_certificates_contain_every_field() -> None:
    """The certificates of these tests contain every field of every kind of statement."""
    for kind, table in FIELDS.items():
        held = set[str]()
        for case in (*CASES, "solution"):
            made = certificate(case)
            if made["kind"] == kind:
                held |= {path for path, _ in entries_of(made["statement"], table)}
        assert held == set(table)


def test_missing_subjects_are_named() -> None:
    """The comparison returns the names of values that the user did not give, and refuses values
    that differ.
    """
    table = {"A": Field("plant"), "K": Field("gain"), "rho": Field()}
    content = {"A": [[1.0]], "K": [[2.0]], "rho": 3.0}
    assert compare(content, table, {}) == ["plant", "gain"]
    assert compare(content, table, {"K": Given([[2.0]], "--weights")}) == ["plant"]
    with pytest.raises(
        NoSolutionError, match="K in the certificate differs from the value of --weights"
    ):
        compare(content, table, {"K": Given([[2.0, 0.0]], "--weights")})
    with pytest.raises(BadInputError, match="does not contain"):
        compare(content, table, {"P": Given([[2.0]], "--weights")})
    with pytest.raises(LookupError):
        compare(content | {"note": 1.0}, table, {})


def test_the_error_ignores_tolerated_differences() -> None:
    """The error names the state whose trim differs by more than the tolerance, not the first
    state.
    """
    stated = {"trim": {"alpha": 0.1, "speed": 50.0, "altitude": 3.0}}
    own = Given(
        {"alpha": 0.1 + 1e-9, "speed": 60.0}, "--at", within({"alpha": 1e-6, "speed": 1e-3})
    )
    table = {"trim": Field("trim")}
    with pytest.raises(NoSolutionError, match="speed in the certificate differs from the value"):
        compare(stated, table, {"trim": own})
    missing = own._replace(value={"alpha": 0.1, "speed": 50.0})
    with pytest.raises(NoSolutionError, match="altitude in the certificate differs"):
        compare(stated, table, {"trim": missing})


def test_options_of_another_kind_are_refused(tmp_path: Path) -> None:
    """Options that do not apply to the certificate are refused, not ignored.

    Examples are an aircraft for a plant's certificate, a plant for an aircraft's certificate, and a
    design without its controller.
    """
    model = hfa.aircraft()
    for kind, options in (
        ("plant", {"dynamics": "published"}),
        ("plant", {"at": (14.0,)}),
        ("rate", {"plant": tmp_path / "plant.npz"}),
        ("rate", {"design": "paper"}),
        ("critic", {"design": "paper"}),
        ("critic", {"basis": "quadratic"}),
    ):
        request = CheckRequest(model=model, typed=frozenset(options), **options)
        made = certificate(kind)
        statement = read_statement(made["kind"], made["statement"])
        with pytest.raises(BadInputError):
            given_for(statement, request)


def test_a_value_of_another_gain_is_refused(tmp_path: Path) -> None:
    """A file with W alone is refused for a statement whose K is not the gain of W.

    A certificate that claims that K is the gain of W is refused too.
    """
    made = certificate("plant")
    statement = read_statement(made["kind"], made["statement"])
    assert not statement.gain_of_value
    weights = tmp_path / "weights.npz"
    np.savez(weights, W=np.array(made["statement"]["critic"]["W"])[:, 0])
    request = CheckRequest(model=hfa.aircraft(), weights=weights, typed=frozenset({"weights"}))
    with pytest.raises(NoSolutionError, match="K is not the gain of the certificate's P or W"):
        given_for(statement, request)
    claimed = copy.deepcopy(made)
    claimed["statement"]["gain_of_value"] = True
    with pytest.raises(NoSolutionError, match="K is not the gain"):
        check_certificate(forge(tmp_path / "claimed.json", claimed))
