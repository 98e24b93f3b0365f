"""What `hfa` refuses: exit code 1 or 2, one line that names the cause, nothing printed, nothing written."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path

import pytest
from cli import Result, assert_refused, hfa

from hfa_cli.main import BAD_INPUT, COMMANDS, FAILED

PARAMETERS = Path(__file__).parents[2] / "hfa_model" / "parameters.toml"
AT_15 = ("--dihedral", "15")


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Every path below a folder, with its content."""
    return {str(path): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


@pytest.fixture(autouse=True)
def untouched(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[None]:
    """Work in a folder with a few things in it, the same afterwards; files `given...` are a test's own."""
    (tmp_path / "folder.json").mkdir()
    (tmp_path / "folder.png").mkdir()
    (tmp_path / "folder.html").mkdir()
    (tmp_path / "file").write_text("a file", encoding="utf-8")
    before = snapshot(tmp_path)
    yield
    after = {path: content for path, content in snapshot(tmp_path).items() if not Path(path).name.startswith("given")}
    assert after == before


@pytest.mark.parametrize("command", ["trim", "linearize"])
@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--dihedral abc", "dihedral is 'abc'"),
        ("--dihedral 95", "dihedral is 95 deg"),
        ("--dihedral -95", "dihedral is -95 deg"),
        ("--dihedral nan", "dihedral is nan"),
        ("--dihedral inf", "dihedral is inf"),
        ("--dihedral=-inf", "dihedral is -inf"),
        ("--dihedral=", "dihedral is ''"),
        ("--dihedral 1e999", "dihedral is 1e999"),
        ("--dihedral 0:20:1", "dihedral is '0:20:1'; give one number: `hfa sweep` takes lists and ranges"),
        ("", "--dihedral"),
        ("--dihedral", "--dihedral"),
        ("--dihedral 15 --speed 0", "speed is 0 ft/s"),
        ("--dihedral 15 --speed -5", "speed is -5 ft/s"),
        ("--dihedral 15 --speed 1e300", "speed is 1e+300 ft/s"),
        ("--dihedral 15 --altitude 300000", "altitude is 300000 ft"),
        ("--dihedral 15 --altitude -1", "altitude is -1 ft"),
        ("--dihedral 15 --alpha 80", "alpha is 80 deg"),
        ("--dihedral 15 --gamma 80", "gamma is 80 deg"),
        ("--dihedral 15 --gamma up", "gamma is 'up'"),
        ("--dihedral 15 --dynamics aristotle", "unknown dynamics 'aristotle'"),
        ("--dihedral 15 --frobnicate", "--frobnicate"),
        ("--dihedral 15 --js", "--js"),
        ("--dihedral 15 elevator", "elevator"),
        ("--dihedral 15 --parameters nowhere.toml", "nowhere.toml"),
        ("--dihedral 15 --parameters folder.json", "folder.json"),
        ("--dihedral 15 --parameters file", "file"),
        ("--dihedral 15 --limit throttle", "throttle"),
        ("--dihedral 15 --limit throttle=1", "throttle"),
        ("--dihedral 15 --limit rudder=0:1", "rudder"),
        ("--dihedral 15 --limit throttle=5:1", "throttle is '5:1'; the first limit must be the lower one"),
        ("--dihedral 15 --limit throttle=a:b", "throttle is 'a'"),
        ("--dihedral 15 --limit throttle=nan:1", "throttle is nan"),
        ("--dihedral 15 --limit dihedral=0:10", "dihedral is 15 deg"),
        ("--dihedral 15 -o result.xyz", "'.xyz'"),
        ("--dihedral 15 -o result", "''"),
        ("--dihedral 15 -o missing/result.json", "the folder missing does not exist"),
        ("--dihedral 15 -o file/result.json", "the folder file does not exist"),
        ("--dihedral 15 -o folder.json", "it is a folder"),
        (f"--dihedral 15 -o {'a' * 300}.json", "a" * 300),
    ],
)
def test_bad_conditions_and_targets(command: str, words: str, named: str) -> None:
    assert_refused(hfa(command, *words.split()), BAD_INPUT, named)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--hold alpha", "'alpha'"),
        ("--hold rudder=1", "rudder"),
        ("--hold alpha=abc", "alpha is 'abc'"),
        ("--hold alpha=nan", "alpha is nan"),
        ("--hold pitch=3", "unknown trim variable 'pitch'"),
        ("--hold flaps=3", "unknown trim variable 'flaps'; choose from speed, alpha, altitude, gamma, pitch_rate,"),
        ("--hold dihedral=10", "dihedral is given twice, by --dihedral and by --hold"),
        ("--speed 68 --hold speed=70", "speed is given twice, by --speed and by --hold; give it once"),
        ("--alpha 3 --hold alpha=3", "alpha is given twice, by --alpha and by --hold"),
        ("--gamma 1 --free gamma", "gamma is given by --gamma and set free by --free"),
        ("--hold throttle=500", "throttle is 500"),
        ("--free rudder", "unknown trim variable 'rudder'"),
        ("--free alpha --hold alpha=3", "alpha is both set free and held"),
        (
            "--hold throttle=1 --hold aileron_outer=0 --hold elevator_center=0 --hold elevator_outer=0",
            "nothing is free",
        ),
        ("--start nowhere.json", "nowhere.json: cannot be read"),
        ("--start folder.json", "folder.json: cannot be read"),
        ("--start file", "file: is not JSON"),
    ],
)
def test_bad_trim_variables(words: str, named: str) -> None:
    assert_refused(hfa("trim", *AT_15, *words.split()), BAD_INPUT, named)


@pytest.mark.parametrize(
    "edit",
    [
        lambda text: text[: len(text) // 2],
        lambda text: text.replace("hfa.operating-point/1", "hfa.operating-point/0"),
        lambda text: text.replace('"speed": 68.0', '"speed": "fast"'),
        lambda text: text.replace('"speed": 68.0', '"speed": NaN'),
        lambda text: text.replace('"speed": 68.0', '"sped": 68.0'),
        lambda text: "[1, 2, 3]",
        lambda text: "null",
        lambda text: "",
        lambda text: "\x00\x01",
    ],
)
def test_a_corrupt_start_is_refused(tmp_path: Path, edit: Callable[[str], str]) -> None:
    given = tmp_path / "given.json"
    assert hfa("trim", *AT_15, "-o", str(given)).code == 0
    text = given.read_text(encoding="utf-8")
    given.write_text(edit(text), encoding="utf-8")
    assert_refused(hfa("trim", *AT_15, "--start", str(given)), BAD_INPUT, str(given))


@pytest.mark.parametrize(
    ("pattern", "replacement", "named"),
    [
        (r"\[chord\]\n(.+\n)+", "", "'chord' is missing"),
        (r"\Z", "\n[rudder]\nvalue = 1.0\n", "'rudder'"),
        (r"(?<=\[chord\]\n)value = .*", "value = -8.0", "[chord] is -8.0"),
        (r"(?<=\[chord\]\n)value = .*", "value = nan", "[chord]"),
        (r"(?<=\[chord\]\n)value = .*", "value = 'eight'", "[chord]"),
        (r'(?<=\[chord\]\nvalue = 8.0\nunit = )"ft"', '"m"', "[chord] is in 'm'"),
    ],
)
@pytest.mark.parametrize("words", [("trim", *AT_15), ("regenerate",), ("report", "--folder", "new")])
def test_bad_parameters_files(
    tmp_path: Path, words: tuple[str, ...], pattern: str, replacement: str, named: str
) -> None:
    given = tmp_path / "given.toml"
    text, count = re.subn(pattern, replacement, PARAMETERS.read_text(encoding="utf-8"), count=1)
    assert count == 1
    given.write_text(text, encoding="utf-8")
    assert_refused(hfa(*words, "--parameters", str(given)), BAD_INPUT, str(given), named)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("", "nothing to sweep"),
        ("--dihedral 20:0:1", "runs backwards from 20 to 0"),
        ("--dihedral 0:1:1e-300", "1e+300 points"),
        ("--dihedral 0:20:0", "step is 0"),
        ("--dihedral 0:20:-1", "step is -1"),
        ("--dihedral 0:1000:1e-6", "1,000,000,001 points"),
        ("--dihedral 0:1:1e-320", "points"),
        ("--dihedral 0:20", "dihedral is LOW:HIGH without a step; give start:stop:step"),
        ("--dihedral 0:20:1:1", "'0:20:1:1'"),
        ("--dihedral 0::1", "dihedral stop is ''"),
        ("--dihedral 1,,2", "dihedral is ''"),
        ("--dihedral a:b:c", "dihedral start is 'a'"),
        ("--dihedral 0:nan:1", "dihedral stop is nan"),
        ("--dihedral 0:20:0.01 --speed 50:80:0.01", "points"),
        ("--dihedral 0:20:5 --dynamics aristotle", "'aristotle'"),
        ("--dihedral 0:20:5 --picture locus.jpg", "'.jpg'"),
        ("--dihedral 0:20:5 --picture folder.png", "it is a folder"),
        ("--dihedral 0:20:5 --speed 60,70 --picture locus.png", "one variable"),
        ("--dihedral 0:20:5 --picture locus.png -o missing/result.json", "missing"),
    ],
)
def test_bad_sweeps(words: str, named: str) -> None:
    assert_refused(hfa("sweep", *words.split()), BAD_INPUT, named)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("identify --seed -1", "--seed is -1"),
        ("identify --seed 1.5", "--seed is 1.5"),
        ("identify --seed x", "--seed is 'x'"),
        ("identify --write missing", "--write missing: there is no such folder"),
        ("identify --write file", "--write file: there is no such folder"),
        ("identify --write . -o folder.json", "it is a folder"),
        ("identify --write . -o result.xyz", "'.xyz'"),
        ("regenerate --dynamics aristotle", "'aristotle'"),
        ("regenerate -o result.html", "'.html'"),
        ("report", "either --output FILE.html or --folder FOLDER"),
        ("report -o page.html --folder new", "either --output FILE.html or --folder FOLDER"),
        ("report -o page.pdf", "'.pdf'"),
        ("report -o folder.html", "it is a folder"),
        ("report --folder missing/new", "--folder missing/new: cannot make the folder"),
        ("report --folder file", "--folder file: cannot make the folder"),
        ("report --folder new --dynamics aristotle", "'aristotle'"),
        ("--frobnicate", "unknown option --frobnicate (see `hfa --help`)"),
        ("frobnicate", "unknown command 'frobnicate' (see `hfa --help`)"),
        ("Trim", "unknown command 'Trim'; did you mean trim?"),
        ("montecarlo", "unknown command 'montecarlo'; did you mean monte-carlo?"),
        ("--verison", "unknown option --verison; did you mean --version?"),
    ],
)
def test_other_bad_requests(words: str, named: str) -> None:
    assert_refused(hfa(*words.split()), BAD_INPUT, named)


@pytest.mark.parametrize("command", COMMANDS)
def test_every_command_refuses_an_unknown_option(command: str) -> None:
    assert_refused(hfa(command, "--frobnicate"), BAD_INPUT, f"hfa {command} --help")


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("trim --speed 20", ("speed by", "ft/s^2", "throttle at its highest")),
        ("linearize --speed 20", ("speed by", "ft/s^2", "throttle at its highest")),
        ("trim --alpha -15", ("alpha by", "rad/s")),
        ("linearize --alpha -15", ("alpha by", "rad/s")),
        ("trim --limit throttle=0:30", ("speed by", "throttle at its highest, 30")),
        ("trim --hold aileron_outer=0 --hold throttle=40", ("dihedral_rate by", "set more free")),
    ],
)
def test_an_untrimmable_point_names_the_equations(words: str, named: tuple[str, ...]) -> None:
    assert_refused(hfa(*words.split(), *AT_15, "-o", "result.json"), FAILED, "no trim", *named)


@pytest.mark.parametrize(
    "wrong",
    [
        Result(0, "", "hfa: speed is 0\n"),
        Result(BAD_INPUT, "a table", "hfa: speed is 0\n"),
        Result(BAD_INPUT, "", "Traceback\nhfa: speed is 0\n"),
        Result(BAD_INPUT, "", "hfa: speed\nis 0\n"),
        Result(BAD_INPUT, "", "hfa: altitude is 0\n"),
    ],
)
def test_the_judge_of_refusals_sees_a_wrong_one(wrong: Result) -> None:
    assert_refused(Result(BAD_INPUT, "", "hfa: speed is 0\n"), BAD_INPUT, "speed")
    with pytest.raises(AssertionError):
        assert_refused(wrong, BAD_INPUT, "speed")
