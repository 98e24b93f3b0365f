"""Packages of other authors add aircraft formats and commands by entry points.

A broken package is reported in one line.
"""

import json
import re
import shutil
import subprocess
import sys
import tomllib

import pytest
from cli import results_in_turn
from pages import COMMAND, blocks_of, difference
from project import ROOT

PAGE = (ROOT / "docs" / "extending.md").read_text("utf-8")


def write_package(folder):
    """Write the code blocks of the page that begin with "# FILE" to files in a folder."""
    for text, name in re.findall(r"^```\w+\n(# (\S+\.\w+)\n.*?)^```$", PAGE, re.M | re.S):
        path = folder / name
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(text, encoding="utf-8")


@pytest.fixture(scope="module")
def site(tmp_path_factory):
    """Return a folder with the example package of docs/extending.md and its metadata."""
    site = tmp_path_factory.mktemp("site")
    write_package(site)
    project = tomllib.loads((site / "pyproject.toml").read_text("utf-8"))["project"]
    groups = [
        f"[{group}]\n" + "".join(f"{name} = {value}\n" for name, value in entries.items())
        for group, entries in project["entry-points"].items()
    ]
    metadata(site, project["name"], "".join(groups))
    return site


#: Commands in docs/extending.md, each with its exit code and output.
OF_THE_PAGE = [
    found
    for block in blocks_of(PAGE)
    if block.language == "console"
    for found in COMMAND.finditer(block.text)
]
#: Further commands for the aircraft of that page and for other files.
OTHERS = (
    "hfa trim --aircraft trainer.pm --at 55 --json",
    "hfa --help",
    "hfa level speed",
    "hfa trim --help",
    "hfa trim --aircraft none.pm",
    "hfa trim --aircraft broken.pm",
    "hfa trim --aircraft trainer.pm",
    "hfa trim --aircraft heavier.pm",
)


@pytest.fixture(scope="module")
def results(site, tmp_path_factory):
    """Return the results of the commands in docs/extending.md and of further commands."""
    folder = tmp_path_factory.mktemp("aircraft")
    write_package(folder)
    shutil.rmtree(folder / "hfa_pointmass")
    (folder / "broken.pm").write_bytes(b"mass \xff")
    heavier = (folder / "trainer.pm").read_text("utf-8").replace("1200", "1300")
    (folder / "heavier.pm").write_text(heavier, encoding="utf-8")
    commands = [*(command[1] for command in OF_THE_PAGE), *OTHERS]
    return results_in_turn(commands, folder, PYTHONPATH=str(site))


@pytest.mark.slow
def test_a_package_adds_an_aircraft_and_a_command(results):
    """The package of the page, a point mass, adds the aircraft format .pm, whose trim has the lift
    of its weight at 55 m/s, and the command `level thrust`. A missing or broken .pm file is
    reported in one line.
    """
    trimmed, overview, unknown, trim_help, missing, broken, *_ = results[len(OF_THE_PAGE) :]
    assert trimmed.code == 0, trimmed.err
    lift = json.loads(trimmed.out)["operating_point"]["inputs"]["lift_coefficient"]
    assert lift == pytest.approx(1200 * 9.80665 / (0.5 * 1.225 * 55**2 * 16.2))
    assert "\npoint mass" in overview.out
    assert "\n  level thrust  thrust and lift-to-drag ratio" in overview.out
    assert (unknown.code, unknown.out) == (2, "")
    assert "unknown word 'speed' after `hfa level`" in unknown.err
    assert "FILE.pm" in trim_help.out
    assert broken.err.startswith("hfa: broken.pm: 'utf-8' codec can't decode byte 0xff")
    assert broken.err.endswith("; correct the file\n")
    assert (
        missing.err
        == "hfa: none.pm cannot be read (No such file or directory); give a readable file\n"
    )


@pytest.mark.slow
def test_commands_of_the_page_print_shown_output(results):
    """Each command in docs/extending.md returns the shown exit code and prints the shown output."""
    assert len(OF_THE_PAGE) >= 5  # the commands are found
    for command, done in zip(OF_THE_PAGE, results, strict=False):
        assert done.code == int(command[2] or 0), f"{command[1]}: {done.out}{done.err}"
        assert not difference(command[3], done.out + done.err)


@pytest.mark.slow
def test_provenance_names_the_file_without_a_source(results):
    """If a reader leaves `source` empty, as that of .pm, the provenance still names the file and
    its hash, which changes with the mass in the file.
    """
    by_command = dict(zip(OTHERS, results[len(OF_THE_PAGE) :], strict=True))
    trainer, heavier = (
        by_command[f"hfa trim --aircraft {name}.pm"].out for name in ("trainer", "heavier")
    )
    given, changed = (
        re.search(r"plant (\w+).pm \(SHA-256 (\w+)\)$", out) for out in (trainer, heavier)
    )
    assert given is not None
    assert changed is not None
    assert (given[1], changed[1]) == ("trainer", "heavier")
    assert given[2] != changed[2]
    assert "parameters identified" not in trainer


def metadata(site, name, entries):
    """Write the metadata of an installed package.

    entries: content of entry_points.txt
    """
    folder = site / f"{name}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(entries)


@pytest.mark.slow
def test_a_broken_package_disables_no_other_command(tmp_path):
    """Of three packages, one that cannot be loaded and one that offers suffixes that the project
    reads itself (.toml, .onnx) are named in one line where they are used. The help of all commands
    is printed, without the broken one and with its name.
    """
    metadata(tmp_path, "broken-one", "[hfa.commands]\nrepair = broken_one:REPAIR\n")
    offers = "[hfa.aircraft]\n.toml = other:read\n[hfa.critics]\n.onnx = other:read\n"
    metadata(tmp_path, "other-files", offers)
    (tmp_path / "uav.toml").write_bytes((ROOT / "examples" / "uav.toml").read_bytes())
    (tmp_path / "a.onnx").write_bytes(b"")
    commands = (
        "hfa repair",
        "hfa trim --aircraft uav.toml",
        "hfa verify --dihedral 15 --weights a.onnx",
        "hfa --help",
    )
    *refused, overview = results_in_turn(commands, tmp_path, PYTHONPATH=str(tmp_path))
    named = ("broken-one offers repair, which cannot", "other-files offers .", "other-files offers")
    for result, words in zip(refused, named, strict=True):
        assert (result.code, result.out, result.err.count("\n")) == (2, "", 1), result.err
        assert f"the package {words}" in result.err
    assert (overview.code, "repair" in overview.out) == (0, False)
    assert "  fly " in overview.out
    assert "broken-one" in overview.err


@pytest.mark.slow
def test_commands_declared_twice_are_refused_by_the_names_of_their_packages(tmp_path):
    """A command that two packages declare is refused with both names, and other commands run."""
    for name in ("one", "other"):
        metadata(tmp_path, f"{name}-glide", f"[hfa.commands]\nglide = {name}_glide:GLIDE\n")
    refused, trimmed = results_in_turn(
        ("hfa glide", "hfa trim --dihedral 10"), tmp_path, PYTHONPATH=str(tmp_path)
    )
    assert (refused.code, refused.out, refused.err.count("\n")) == (2, "", 1)
    assert all(words in refused.err for words in ("one-glide", "other-glide", "both offer glide"))
    assert trimmed.code == 0


@pytest.mark.slow
def test_a_package_does_not_replace_a_command_of_hfa(tmp_path):
    """The help of `hfa export` is that of hfa although a package declares a command `export`, and
    the help of all commands names this package.
    """
    metadata(tmp_path, "other-export", "[hfa.commands]\nexport = other_export:EXPORT\n")
    asked, overview = results_in_turn(
        ("hfa export --help", "hfa --help"), tmp_path, PYTHONPATH=str(tmp_path)
    )
    assert (asked.code, asked.err) == (0, "")
    assert asked.out.startswith("usage: hfa export")
    assert (overview.code, "  export " in overview.out) == (0, True)
    assert "the package other-export declares `hfa export`, a command of hfa" in overview.err


#: Program that loads every command without the packages of the extras.
WITHOUT_EXTRAS = """
import sys
for name in "distributed flint gymnasium jsbsim onnx plotly reportlab xarray zarr".split():
    sys.modules[name] = None
import hfa
from hfa.entry_points import commands
for entry in commands().values():
    entry.load()
for name in ("assess", "fly", "identify", "optimize", "sweep", "verify"):
    getattr(hfa, name)
"""


@pytest.mark.slow
def test_commands_load_without_packages_of_extras():
    """Without optional packages, all commands are loaded, and so are functions of all extensions
    but those that prove.
    """
    done = subprocess.run([sys.executable, "-c", WITHOUT_EXTRAS], capture_output=True, text=True)
    assert done.stderr == ""
