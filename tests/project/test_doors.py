"""Packages of anybody's add aircraft and commands, and one that is broken is named in one line."""

from __future__ import annotations

import json
import shutil
import subprocess
import sys
from pathlib import Path

import pytest
from cli import Result, hfa_process
from project import FOLDERS, ROOT, SETTINGS

EXTENSIONS = tuple(sorted(path.name for path in ROOT.glob("extensions/*/hfa_*")))


@pytest.fixture(scope="module")
def site(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A folder into which pip has installed the toy, a distribution of its own."""
    source = tmp_path_factory.mktemp("source") / "toy"
    shutil.copytree(ROOT / "tests" / "project" / "toy", source)
    site = tmp_path_factory.mktemp("site")
    options = ("--quiet", "--no-deps", "--no-build-isolation", "--disable-pip-version-check")
    words = [sys.executable, "-m", "pip", "install", *options, "--target", site, source]
    subprocess.run(words, check=True, timeout=120)
    return site


def run(site: Path, folder: Path, *words: str) -> Result:
    """`hfa words...` where the packages of a folder are installed too."""
    return hfa_process(*words, folder=folder, PYTHONPATH=str(site))


def test_a_package_adds_an_aircraft_and_a_command(site: Path, tmp_path: Path) -> None:
    (tmp_path / "my.cart").write_text("2 0.5")
    trimmed = run(site, tmp_path, "trim", "--aircraft", "my.cart", "--json")
    assert trimmed.code == 0, trimmed.err
    assert json.loads(trimmed.out)["operating_point"]["inputs"]["thrust"] == pytest.approx(5.0)
    greeted = run(site, tmp_path, "greet", "aircraft", "--aircraft", "my.cart", "--loudly")
    assert (greeted.code, greeted.out) == (0, "HELLO, CART\n")
    overview = run(site, tmp_path, "--help").out
    assert "\ngreeting\n  greet aircraft  say the name of an aircraft\n" in overview
    unknown = run(site, tmp_path, "greet", "plane")
    assert (unknown.code, unknown.out) == (2, "")
    assert "unknown word 'plane' behind `hfa greet`" in unknown.err


def test_an_aircraft_of_a_package_is_nobody_elses(site: Path, tmp_path: Path) -> None:
    """A reader that fills no `source`: the footer names its file, a changed file has another hash,
    and workers read it again."""
    (tmp_path / "my.cart").write_text("2 0.5")
    text = run(site, tmp_path, "trim", "--aircraft", "my.cart").out
    assert "plant my.cart (SHA-256 " in text.splitlines()[-1]
    assert "parameters" not in text
    (tmp_path / "my.cart").write_text("2 0.6")
    assert run(site, tmp_path, "trim", "--aircraft", "my.cart").out != text
    words = ("--hold", "speed=1:4:1", "--workers", "2", "-o", "cart.zarr")
    swept = run(site, tmp_path, "sweep", "--aircraft", "my.cart", *words)
    assert (swept.code, "trimmed             4" in swept.out) == (0, True), swept.out + swept.err


def test_a_command_without_a_request_is_refused(tmp_path: Path) -> None:
    (tmp_path / "stranger.py").write_text(
        "from hfa.doors import CommandEntry\nfrom hfa.options.command import command\n"
        "RUN = CommandEntry('model', 'run', 'stranger:run')\n"
        "@command(dict)\ndef run(request):\n    return 0\n"
    )
    metadata(tmp_path, "stranger", "[hfa.commands]\nrunning = stranger:RUN\n")
    done = run(tmp_path, tmp_path, "running")
    assert done.code == 2
    assert "stranger:run is no command; write @command(OPTIONS)" in done.err


def metadata(site: Path, name: str, entries: str) -> None:
    """What an installed package tells of itself: its name and its entry points."""
    folder = site / f"{name}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(entries)


def test_a_package_that_cannot_be_loaded_is_named_and_nothing_else_fails(tmp_path: Path) -> None:
    metadata(tmp_path, "broken-one", "[hfa.commands]\nrepair = broken_one:REPAIR\n")
    refused = run(tmp_path, tmp_path, "repair")
    assert (refused.code, refused.out, refused.err.count("\n")) == (2, "", 1)
    assert "the package broken-one offers repair, which cannot be loaded" in refused.err
    overview = run(tmp_path, tmp_path, "--help")
    assert (overview.code, "repair" in overview.out) == (0, False)
    assert "  fly " in overview.out
    assert "broken-one" in overview.err


def test_a_name_that_two_packages_offer_is_refused(tmp_path: Path) -> None:
    metadata(tmp_path, "other-flights", "[hfa.commands]\nfly = other_flights:FLY\n")
    refused = run(tmp_path, tmp_path, "fly", "--dihedral", "15")
    assert (refused.code, refused.out, refused.err.count("\n")) == (2, "", 1)
    assert "other-flights" in refused.err
    assert "both offer fly" in refused.err
    assert run(tmp_path, tmp_path, "trim", "--dihedral", "10").code == 0


def test_the_wall_has_every_package() -> None:
    """The contract that the core knows no extension is about everything but the core."""
    packages = set(FOLDERS)
    core = packages - set(EXTENSIONS)
    contracts = SETTINGS["importlinter"]["contracts"]
    (wall,) = (
        contract for contract in contracts if contract["name"].startswith("The core knows no")
    )
    assert len(EXTENSIONS) >= 8
    assert set(wall["forbidden_modules"]) == set(EXTENSIONS)
    assert set(wall["source_modules"]) == core
    assert "ignore_imports" not in wall
    assert packages | {"studies"} == set(SETTINGS["importlinter"]["root_packages"])
    (layers,) = (
        contract for contract in contracts if contract["name"].startswith("An extension imports")
    )
    named = [name.strip() for layer in layers["layers"] for name in layer.split("|")]
    assert sorted(named) == list(EXTENSIONS)
