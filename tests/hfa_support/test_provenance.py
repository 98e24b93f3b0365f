"""Provenance of a result in its text and files, and lines on standard error."""

import pytest

from hfa_support.errors import BadInputError
from hfa_support.origin import code
from hfa_support.provenance import Change, Provenance, now
from hfa_support.version import VERSION


@pytest.mark.parametrize(
    ("entries", "text"),
    [
        ({"model": "a.npz"}, "plant a.npz"),
        (
            {"dynamics": "newton", "parameters": "identified", "parameter_hash": "1f"},
            "newton dynamics, parameters identified (1f)",
        ),
        (
            {"model": "a.toml", "parameters": "b.toml", "parameter_hash": "1f"},
            "plant a.toml, parameters b.toml (1f)",
        ),
        (
            {"model": "a.toml", "changed": {"mass": Change(9.0, 13.5, "kg")}},
            "plant a.toml\nchanged: mass 9 kg (as loaded: 13.5 kg)",
        ),
        (
            {
                **{"dynamics": "d", "parameters": "p", "flight": "gamma 2 deg"},
                "changed": {
                    name: Change(value, usual)
                    for name, value, usual in (
                        ("a", 1.1, 1),
                        ("b", 5, 0),
                        ("c", 8, 10),
                        ("d", 0, 2),
                    )
                },
            },
            "d dynamics, parameters p ()\nnot the identified aircraft: 4 parameters differ, most\n"
            "  b 5 (identified: 0)\n  d 0 (identified: 2)\n  c 8 (identified: 10)\n"
            "not the paper's level flight: gamma 2 deg",
        ),
    ],
)
def test_the_text_of_a_provenance_names_plant_parameters_and_flight(entries, text):
    """The first line has version, day and plant; changed parameters are sorted by their change."""
    origin = Provenance("hfa trim", date="2026-05-04T10:00", **entries)
    assert origin.text() == f"hfa {VERSION}, 2026-05-04, {text}"
    data = origin.to_dict()
    assert (data["version"], "flight" in data, data["command"]) == (code(), False, "hfa trim")


def test_the_date_is_that_of_the_environment(monkeypatch):
    """SOURCE_DATE_EPOCH is in seconds since 1970; without it, the date is today's."""
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "86400")
    assert now().startswith("1970-01-02")
    monkeypatch.setenv("SOURCE_DATE_EPOCH", "9" * 30)
    with pytest.raises(BadInputError, match="SOURCE_DATE_EPOCH is '999"):
        now()
    for other in ("soon", ""):
        monkeypatch.setenv("SOURCE_DATE_EPOCH", other)
        assert now() > "2026"
