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


#: Commands in docs/extending.md, each with the shown exit code ("" of 0) and output.
SHOWN = [
    found
    for block in blocks_of(PAGE)
    if block.language == "console"
    for found in COMMAND.findall(block.text.replace("\\\n", " "))
]
#: Further commands for the aircraft of that page.
FURTHER = ("hfa trim --aircraft trainer.pm --at 55 --json", "hfa trim --help")


@pytest.fixture(scope="module")
def results(site, tmp_path_factory):
    """Return command -> result, of `SHOWN` and `FURTHER`, with the package of docs/extending.md."""
    folder = tmp_path_factory.mktemp("aircraft")
    write_package(folder)
    shutil.rmtree(folder / "hfa_pointmass")
    commands = [*(command for command, _, _ in SHOWN), *FURTHER]
    return dict(zip(commands, results_in_turn(commands, folder, PYTHONPATH=str(site)), strict=True))


@pytest.mark.slow
def test_a_package_adds_an_aircraft_format(results):
    """The package of the page, a point mass, adds the aircraft format .pm, which the help of `hfa
    trim` names. The trim of trainer.pm, 1200 kg, has the lift coefficient of its weight at 55 m/s.
    """
    trimmed = results["hfa trim --aircraft trainer.pm --at 55 --json"]
    assert trimmed.code == 0, trimmed.err
    lift = json.loads(trimmed.out)["operating_point"]["inputs"]["lift_coefficient"]
    assert lift == pytest.approx(1200 * 9.80665 / (0.5 * 1.225 * 55**2 * 16.2))
    assert "FILE.pm" in results["hfa trim --help"].out


@pytest.mark.slow
def test_commands_of_the_page_print_shown_output(results):
    """Each command in docs/extending.md returns the shown exit code and prints the shown output."""
    assert len(SHOWN) >= 5  # the commands are found
    for command, code, output in SHOWN:
        done = results[command]
        assert done.code == int(code or 0), f"{command}: {done.out}{done.err}"
        assert not difference(output, done.out + done.err)


def metadata(site, name, entries):
    """Write the metadata of an installed package.

    entries: content of entry_points.txt
    """
    folder = site / f"{name}-1.0.dist-info"
    folder.mkdir(parents=True)
    (folder / "METADATA").write_text(f"Metadata-Version: 2.1\nName: {name}\nVersion: 1.0\n")
    (folder / "entry_points.txt").write_text(entries)


#: What goes wrong -> package -> its entry points; a command that is refused; words of its line.
WRONG = {
    "cannot be loaded": (
        {"broken-one": "[hfa.commands]\nrepair = broken_one:REPAIR\n"},
        "repair",
        "the package broken-one offers repair, which cannot",
    ),
    "reads what hfa reads": (
        {"other-files": "[hfa.aircraft]\n.toml = other:read\n"},
        "trim --aircraft uav.toml",
        "the package other-files offers .",
    ),
    "reads critics that hfa reads": (
        {"other-files": "[hfa.critics]\n.onnx = other:read\n"},
        "verify --dihedral 15 --weights a.onnx",
        "the package other-files offers .",
    ),
    "declared twice": (
        {name: f"[hfa.commands]\nglide = {name}:GLIDE\n" for name in ("one", "two")},
        "glide",
        "both offer glide",
    ),
}


@pytest.mark.slow
@pytest.mark.parametrize("what", WRONG)
def test_a_wrong_package_disables_no_other_command(what, tmp_path):
    """A command of a package that cannot be loaded, or that offers what another one offers, is refused
    in one line with the name of the package, and other commands run.
    """
    packages, command, words = WRONG[what]
    for name, entries in packages.items():
        metadata(tmp_path, name, entries)
    (tmp_path / "uav.toml").write_bytes((ROOT / "examples" / "uav.toml").read_bytes())
    (tmp_path / "a.onnx").write_bytes(b"")
    refused, trimmed = results_in_turn(
        (f"hfa {command}", "hfa trim --dihedral 10"), tmp_path, PYTHONPATH=str(tmp_path)
    )
    assert (refused.code, refused.out, refused.err.count("\n")) == (2, "", 1), refused.err
    assert words in refused.err
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
    """Without the optional packages that `WITHOUT_EXTRAS` makes impossible to import, all commands
    are loaded, and so are public functions of each extension except hfa_prove.
    """
    done = subprocess.run([sys.executable, "-c", WITHOUT_EXTRAS], capture_output=True, text=True)
    assert done.stderr == ""
