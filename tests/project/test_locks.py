"""The locked versions can be installed with every supported Python."""

import re
import tomllib

import pytest
from packaging.requirements import Requirement
from packaging.utils import canonicalize_name
from project import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]


def entries(lock):
    """Return the entries of a lock file, each a requirement followed by hashes, on one line."""
    lines = (ROOT / "tools" / lock).read_text("utf-8").replace("\\\n", "").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def pins(lock):
    return [Requirement(line.partition("--hash")[0]) for line in entries(lock)]


#: Lock file -> the extra of pyproject.toml that is installed from it.
LOCKS = {
    "requirements-report.lock": "page",
    "requirements-docs.lock": "docs",
    "requirements-test.lock": "test",
    "requirements.lock": "dev",
}


@pytest.mark.parametrize(("lock", "extra"), LOCKS.items())
def test_a_lock_pins_allowed_versions_of_its_extra(lock, extra):
    """A lock file has one version of each dependency of the project and of each package of its
    extra, and pyproject.toml allows this version.
    """
    pinned = {canonicalize_name(pin.name): pin for pin in pins(lock)}
    for line in (*PROJECT["dependencies"], *PROJECT["optional-dependencies"][extra]):
        wanted = Requirement(line)
        (exact,) = pinned[canonicalize_name(wanted.name)].specifier
        assert wanted.specifier.contains(exact.version), line


@pytest.mark.parametrize("lock", LOCKS)
def test_every_pin_is_that_of_the_largest_lock_and_names_no_host(lock):
    """Each entry of a lock file, one exact version with its hashes, is also in the largest lock file.
    The file names no index, host or path.
    """
    assert {*entries(lock)} <= {*entries("requirements.lock")}
    text = (ROOT / "tools" / lock).read_text("utf-8")
    assert not re.search("://|--(extra-)?index-url|--find-links|--trusted-host", text)
