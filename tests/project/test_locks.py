"""The locked versions can be installed with every supported Python."""

import importlib.metadata
import re
import tomllib

import pytest
from packaging.markers import default_environment
from packaging.requirements import Requirement
from packaging.specifiers import SpecifierSet
from packaging.utils import canonicalize_name
from project import ROOT

PROJECT = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
#: The versions with which `make test-matrix` runs the tests.
PYTHONS = re.findall(r'"(3\.\d+)"', (ROOT / "noxfile.py").read_text("utf-8"))


def entries(lock):
    """Return the entries of a lock file, each a requirement followed by hashes, on one line."""
    lines = (ROOT / "tools" / lock).read_text("utf-8").replace("\\\n", "").splitlines()
    return [line for line in lines if line and not line.startswith("#")]


def pins(lock):
    return [Requirement(line.partition("--hash")[0]) for line in entries(lock)]


def excluded_pythons(specifier):
    """Return the supported Python versions that a Requires-Python specifier excludes."""
    return [each for each in PYTHONS if not SpecifierSet(specifier).contains(f"{each}.0")]


#: Lock file -> the extra of pyproject.toml that is installed from it.
LOCKS = {
    "requirements-report.lock": "page",
    "requirements-docs.lock": "docs",
    "requirements-test.lock": "test",
    "requirements.lock": "dev",
}


@pytest.mark.parametrize("lock", LOCKS)
def test_locked_packages_support_every_supported_python(lock):
    """Each locked package supports every Python version that the project supports.

    Only packages that are installed here in the locked version are compared, at least 10: the
    metadata of others are not available.
    """
    assert not excluded_pythons(PROJECT["requires-python"])
    assert SpecifierSet(PROJECT["requires-python"]) == SpecifierSet(f">={PYTHONS[0]}")
    excluded = {}
    compared = 0
    for pin in pins(lock):
        if pin.marker and not pin.marker.evaluate(dict(default_environment())):
            continue
        try:
            installed = importlib.metadata.distribution(pin.name)
        except importlib.metadata.PackageNotFoundError:
            continue
        if installed.version not in pin.specifier:
            continue
        compared += 1
        unsupported = excluded_pythons(installed.metadata.get("Requires-Python", ""))
        if unsupported:
            excluded[str(pin)] = unsupported
    assert compared >= 10
    assert excluded == {}


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
def test_all_locks_pin_the_same_versions(lock):
    """Each lock file has the pins of the smallest one, for `hfa report`, and only pins of the
    largest one, for development.
    """
    smallest, pinned, largest = (
        {str(pin) for pin in pins(name)}
        for name in ("requirements-report.lock", lock, "requirements.lock")
    )
    assert smallest <= pinned <= largest


@pytest.mark.parametrize("lock", LOCKS)
def test_every_pin_has_hashes_and_names_no_host(lock):
    """Each entry of a lock file is one exact version with SHA-256 hashes, which are those of the
    same package in the largest lock file. The file names no index, host or path.
    """
    in_largest = {
        each.partition("==")[0]: each.split("--hash")[1:] for each in entries("requirements.lock")
    }
    for entry in entries(lock):
        name, _, rest = entry.partition("==")
        requirement, *hashes = rest.split("--hash")
        assert re.fullmatch(r"[\w.]+( ; [^;]+)?\s*", requirement), entry
        assert hashes, name
        assert all(re.fullmatch(r"=sha256:[0-9a-f]{64}\s*", each) for each in hashes), name
        assert sorted(map(str.strip, hashes)) == sorted(map(str.strip, in_largest[name])), name
    text = (ROOT / "tools" / lock).read_text("utf-8")
    assert not re.search("://|--(extra-)?index-url|--find-links|--trusted-host", text)
