"""Public names of the packages, which are imported when they are used."""

import re
from collections import Counter

import pytest
from project import FOLDERS, PACKAGES

import hfa
import trim
from hfa_support.version import VERSION

STUBS = [
    *(FOLDERS[name] / "__init__.pyi" for name in PACKAGES),
    *(FOLDERS["hfa"] / name / "__init__.pyi" for name in ("paper", "extend")),
]


def test_an_unknown_name_suggests_the_nearest() -> None:
    """The AttributeError for an unknown public name suggests the nearest name."""
    with pytest.raises(AttributeError, match="'linearise'; did you mean linearize"):
        hfa.linearise  # noqa: B018
    with pytest.raises(AttributeError, match="'modes_off'; did you mean modes_of"):
        trim.modes_off  # noqa: B018
    with pytest.raises(AttributeError, match="'read'; did you mean read_critic"):
        hfa.read  # noqa: B018
    assert (hfa.trim, hfa.verify) == (hfa.trim, hfa.verify)
    assert set(dir(hfa)) >= {"linearize", "sweep"}


def test_a_public_name_is_declared_once() -> None:
    """No public name is declared in two stubs."""
    names = Counter(
        name for stub in STUBS for name in re.findall(r" as (\w+)", stub.read_text("utf-8"))
    )
    assert len(names) > 100
    assert [name for name, count in names.items() if count > 1] == []


def test_the_core_stubs_name_no_extension() -> None:
    """The stubs of core packages, except `hfa`, import no name of an extension."""
    core = [stub for stub in STUBS if "extensions" not in stub.parts and stub.parent.name != "hfa"]
    assert len(core) >= 6
    for stub in core:
        known = re.findall(r"^from (hfa_\w+)", stub.read_text("utf-8"), re.M)
        assert set(known) <= {"hfa_aircraft", "hfa_model", "hfa_support"}


def test_the_version_and_inner_packages_are_public() -> None:
    """`hfa.__version__` and the subpackage `hfa.paper` are public."""
    assert hfa.__version__ == VERSION
    assert hfa.paper.__name__ == "hfa.paper"
