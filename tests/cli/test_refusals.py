"""What `hfa` refuses: exit code 1 or 2, one line that names cause and remedy, nothing written."""

from __future__ import annotations

import re
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from cli import assert_refused, hfa
from game_files import small, stored

from hfa_cli.main import BAD_INPUT, COMMANDS, FAILED
from hfa_model import LINEAR_STATES

PARAMETERS = Path(__file__).parents[2] / "hfa_model" / "parameters.toml"
DIGITS = "9" * 5000


def snapshot(folder: Path) -> dict[str, bytes | None]:
    """Every path below a folder, with its content."""
    return {str(path): path.read_bytes() if path.is_file() else None for path in sorted(folder.rglob("*"))}


@pytest.fixture(autouse=True)
def untouched(tmp_path: Path) -> Iterator[None]:
    """Work in a folder with a few things in it, the same afterwards; files `given...` are a test's own."""
    for name in ("folder.json", "folder.png", "folder.html"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").write_text("a file", encoding="utf-8")
    before = snapshot(tmp_path)
    yield
    after = {path: content for path, content in snapshot(tmp_path).items() if not Path(path).name.startswith("given")}
    assert after == before


REFUSED = {
    "trim": [
        ("", "the following arguments are required: --dihedral (see `hfa trim --help`)"),
        ("15", "unrecognized arguments: 15 (see `hfa trim --help`)"),
        ("--dihedral", "--dihedral expected one argument"),
        ("--dihedrl 15", "unknown option --dihedrl; did you mean --dihedral?"),
        ("--dihedral abc --quite", "unknown option --quite; did you mean --quiet?"),
        (f"--{'x' * 5000}", "unknown option --xxxx"),
        ("--\x1b[31m", "unknown option --\\x1b[31m"),
        ("--dihedral=--", "--dihedral is '--'; give a value"),
        (f"--dihedral {DIGITS}", "--dihedral is 9999"),
        ("--dihedral 15 --parameters folder.json", "folder.json"),
        ("--dihedral 15 --units metric", "--units is 'metric'; use one of english, si"),
        ("--dihedral 15 --hold alpha", "'alpha' is not NAME=VALUE"),
        ("--dihedral 15 --hold alpha=nan", "alpha is nan"),
        ("--dihedral 15 --hold flaps=3", "unknown trim variable 'flaps'; choose from speed, alpha, altitude, gamma,"),
        ("--dihedral 15 --hold dihedral=10", "dihedral is given twice, by --dihedral and by --hold"),
        ("--dihedral 15 --hold gamma=1 --free gamma", "gamma is both set free and held"),
        ("--dihedral 15 --start file", "file: is not JSON"),
        ("--dihedral 15 --picture none/front.png", "the folder none does not exist"),
    ],
    "linearize": [
        ("--dihedral 95", "dihedral is 95 deg"),
        ("--dihedral=-inf", "dihedral is -inf"),
        ("--dihedral 0:20:1", "dihedral is '0:20:1'; give one number: `hfa sweep` takes lists and ranges"),
        ("--dihedral 15 --hold speed=1e300", "speed is 1e+300 ft/s"),
        ("--dihedral 15 --dynamics aristotle", "unknown dynamics 'aristotle'"),
        ("--dihedral 15 elevator", "unrecognized arguments: elevator"),
        ("--dihedral 15 --limit throttle=1", "throttle is '1'; give LOW:HIGH"),
        ("--dihedral 15 --limit throttle=5:1", "throttle is '5:1'; the first limit must be the lower one"),
        ("--dihedral 15 --outputs lift", "--outputs names 'lift'; choose from speed, alpha"),
        ("--dihedral 15 --inputs throttle,throttle", "--inputs names throttle twice; name it once"),
        ("--dihedral 15 -o result.xyz", "'.xyz'"),
        ("--dihedral 15 -o folder.json", "it is a folder"),
        (f"--dihedral 15 -o {'a' * 300}.json", "a" * 300),
    ],
    "sweep": [
        ("", "nothing to sweep"),
        ("--dihedral 20:0:1", "runs backwards from 20 to 0"),
        ("--dihedral 0:1:1e-300", "1e+300 points"),
        ("--dihedral 0:1000:1e-6", "1,000,000,001 points"),
        ("--dihedral 0:20", "dihedral is '0:20'; give start:stop:step"),
        ("--dihedral 0::1", "one part is ''"),
        ("--dihedral 0:20:0.01 --hold speed=50:80:0.01", "points"),
        ("--dihedral 0:20:5 --hold speed=60,70 --picture locus.png", "one variable"),
        ("--dihedral 0:5:1 -o a.zarr --workers 1e308", "--workers is 1e308; give a whole number from 1 to 1000"),
        ("--dihedral 0:5:1 --units si -o a.zarr", "--units does not go with a store"),
        ("--dihedral 5 --free dihedral", "dihedral is given by --dihedral and set free by --free"),
        ("--dihedral 5 --hold throttle=0:40:20 --free throttle", "throttle is both set free and held"),
        ("--dihedral 0 --hold flaps=1:2:1", "cannot sweep 'flaps'"),
        ("--dihedral 10,30 --condition simvfa-64", "30 deg lies outside"),
    ],
    "solve": [
        ("", "either --dihedral DEG or --model FILE"),
        ("--dihedral 15 --delta 0", "delta is 0.0; it must be a positive number"),
        ("--dihedral 15 --delta 1e-60", "1/delta^2 must not exceed 1e+100"),
        ("--dihedral 15 --R 100,400,400,400,0", "R is not positive definite (smallest eigenvalue 0); make every"),
        ("--dihedral 15 --R 100,400,400,400", "R is 4 x 4; with this A and B it must be 5 x 5"),
        ("--dihedral 15 --Q 1,two,3,4,5,6", "Q: entry 2 is 'two'; give the diagonal as numbers"),
        ("--model given.json --hold speed=70", "--hold belongs to the aircraft; leave it out with --model"),
        ("--model given.json --units si", "--units belongs to the aircraft"),
        ("--model given.xlsx", "the suffix '.xlsx' is not known; use .json, .npz"),
    ],
    "learn": [
        ("--dihedral 15 --law sarsa", "unknown law 'sarsa'; choose from certified"),
        ("--dihedral 15 --set samples=20", "20 samples cannot determine 21 weights; record at least 21"),
        (f"--dihedral 15 --set samples={DIGITS}", "samples is 9999"),
        ("--dihedral 15 --set basis=cubic", "unknown basis 'cubic'; choose from quadratic, quadratic+linear"),
        ("--dihedral 15 --set initial_weights=1,2,3", "initial weights are (3,); basis 'quadratic' has 21 weights"),
        ("--dihedral 15 --set speed=1", "law 'certified' has no setting 'speed'; choose from predefined_time"),
        ("--dihedral 15 --Q 0,0,0,0,0,0", "Q is zero: every law measures its residual against z'Qz"),
        ("--dihedral 15 --set tick=1e-320", "a number is too large or too small to compute with"),
    ],
    "verify": [
        ("--dihedral 15 --basis quadratic", "use --set basis="),
        ("--dihedral 15 --weights given.npz --law certified", "--law belongs to a law; leave it out with --weights"),
        ("--dihedral 15 --weights given.npz --limit-error 0", "--limit-error is 0; it must be positive"),
    ],
    "design": [
        ("given.npz", "given.npz: this is no controller file"),
        ("--design paper --dihedral 0:5", "--dihedral is '0:5'; give start:stop:step"),
        ("--design servo --units si -o a.npz", "a controller is in ft, slug, lbf"),
    ],
    "fly": [
        ("--dihedral 15 --law exact --seed 3", "here nothing is random"),
        ("--dihedral 15 --law exact --gust 50:5:30", "--gust begins at 30 s"),
        ("--dihedral 15 --gust 400:10 --turbulence 5:1750", "do not go together"),
        ("--dihedral 15 --turbulence 5", "--turbulence is '5'; give SIGMA:SCALE"),
        ("--dihedral 15 --law exact --command speed=1:2:0", "--command speed frequency is 0"),
        ("--dihedral 15 --law exact --actuators 0.05:-3", "--actuators rate is -3 deg/s"),
        ("--dihedral 15 --fault 0.2:0.5", "--fault belongs to --actuators"),
        ("--dihedral 15 --command gamma=1:1", "a gain follows no command of 'gamma'"),
        ("--dihedral 15 --duration 1e8", "duration is 1e+08 s; with a step of 0.001 s it must not exceed 10000 s"),
        ("--dihedral 15 --initial paper --initial speed=1", "--initial paper goes alone"),
        ("--dihedral 15 --error span=0.9", "unknown parameter 'span'"),
        ("--dihedral 15 --envelope dihedral=0:10", "outside the envelope"),
    ],
    "schedule": [
        ("--dihedral 15 --to 15", "two different ones"),
        ("--dihedral 15 --to 16:5 --duration 1", "ends at 10 s"),
        ("--dihedral 15 --to 20 --weights given.npz", "there is no K of 5 x 6"),
    ],
    "map": [
        ("--dihedral 15 --initial speed=1:0:1", "runs backwards"),
        ("--dihedral 15 --initial alpha=1", "--initial alpha is not among speed, dihedral"),
    ],
    "monte-carlo": [
        ("--dihedral 15 --samples 1e9", "give a whole number from 1 to 1e+07"),
        ("--dihedral 15 --workers tcp://a:b", "no Dask scheduler answers at tcp://a:b"),
        ("--dihedral 15 --error panel_mass=-0.1", "-0.1"),
        ("--dihedral 15 --resume", "-o FILE.zarr"),
        ("--dihedral 15 --law exact --set predefined_time=2", "--set belongs to a learning law"),
        ("--dihedral 15 --units si -o a.zarr", "a store is in ft"),
    ],
    "export": [
        ("", "the following arguments are required: --output"),
        ("-o aircraft.zip", "aircraft.zip: unknown suffix '.zip'; use one of .fmu, .m"),
        ("-o 2-models.m", "2-models.m: a function is called by its file's name"),
        ("-o missing/folder", "missing/folder: cannot make the folder"),
        ("-o out --law magic", "unknown law 'magic'"),
        ("-o out --set samples=30", "--set belongs to a learning law"),
        ("-o out --actuators 0.5:60", "--actuators belongs to --controller; leave it out"),
    ],
    "report": [
        ("", "--output FILE.html or --output FOLDER"),
        ("-o page.pdf", "'.pdf'"),
        ("-o folder.html", "it is a folder"),
        ("-o file", "cannot make the folder"),
        ("-o a.html --free dihedral", "the angles of a report are given by --dihedral and --sweep"),
    ],
    "identify": [("--seed 1.5", "--seed is 1.5"), ("--units si -o a.toml", "a parameters file is in ft, slug, lbf")],
    "prove": [("--units si", "unknown option --units")],
}


@pytest.mark.parametrize(
    ("command", "words", "named"), [(command, *each) for command, some in REFUSED.items() for each in some]
)
def test_bad_requests(command: str, words: str, named: str) -> None:
    small("given.json")
    stored("given.npz", W=np.ones(21))
    result = hfa(command, *words.split())
    assert_refused(result, BAD_INPUT, named)
    assert result.err.rstrip("\n").isprintable()
    assert len(result.err) < 700


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("--frobnicate", "unknown option --frobnicate (see `hfa --help`)"),
        ("frobnicate", "unknown command 'frobnicate' (see `hfa --help`)"),
        ("montecarlo", "unknown command 'montecarlo'; did you mean monte-carlo?"),
        ("x" * 5000, "unknown command 'xxxx"),
        *((f"{command} --frobnicate", f"hfa {command} --help") for command in COMMANDS),
    ],
)
def test_unknown_commands_and_options(words: str, named: str) -> None:
    assert_refused(hfa(*words.split()), BAD_INPUT, named)


@pytest.mark.parametrize(
    ("pattern", "replacement", "named"),
    [
        (r"\[chord\]\n(.+\n)+", "", "chord is missing"),
        (r"\Z", "\n[rudder]\nvalue = 1.0\n", "unknown entry rudder"),
        (r"(?<=\[chord\]\n)value = .*", "value = -8.0", "chord.value is -8.0"),
        (r"(?<=\[chord\]\n)value = .*", "value = 'eight'", "chord.value is 'eight'"),
        (r'(?<=\[chord\]\nvalue = 8.0\nunit = )"ft"', '"m"', "chord.unit is 'm'; give ft"),
    ],
)
@pytest.mark.parametrize("words", ["trim --dihedral 15", "regenerate", "report -o new"])
def test_bad_parameters_files(words: str, pattern: str, replacement: str, named: str) -> None:
    text, count = re.subn(pattern, replacement, PARAMETERS.read_text(encoding="utf-8"), count=1)
    assert count == 1
    Path("given.toml").write_text(text, encoding="utf-8")
    assert_refused(hfa(*words.split(), "--parameters", "given.toml"), BAD_INPUT, "given.toml", named)


@pytest.mark.parametrize(
    "edit",
    [
        lambda text: text[: len(text) // 2],
        lambda text: text.replace("hfa.operating-point/1", "hfa.operating-point/0"),
        lambda text: text.replace('"speed": 68.0', '"speed": "fast"'),
        lambda text: text.replace('"speed": 68.0', '"sped": 68.0'),
        lambda _: "[1, 2, 3]",
        lambda _: "\x00\x01",
    ],
)
def test_a_corrupt_start_is_refused(edit: Any) -> None:
    assert hfa("trim", "--dihedral", "15", "-o", "given.json").code == 0
    Path("given.json").write_text(edit(Path("given.json").read_text(encoding="utf-8")), encoding="utf-8")
    assert_refused(hfa("trim", "--dihedral", "15", "--start", "given.json"), BAD_INPUT, "given.json")


@pytest.mark.parametrize("command", ["solve", "learn", "verify"])
@pytest.mark.parametrize(
    ("changes", "code", "named"),
    [
        ({"A": None}, BAD_INPUT, "there is no A"),
        ({"A": [[1.0, 2.0, 3.0], [4.0, 5.0, 6.0]]}, BAD_INPUT, "A is 2 x 3; it must be square"),
        ({"B": [[0.0], [np.inf]]}, BAD_INPUT, "B[1][0] is inf; every entry must be finite"),
        ({"E": [[1.0]]}, BAD_INPUT, "E is 1 x 1; with this A and B it must be 2 x 1"),
        ({"R": [[-1.0]]}, BAD_INPUT, "R is not positive definite"),
        ({"Q": [[1.0, 2.0], [2.0, 1.0]]}, BAD_INPUT, "Q is not positive semidefinite"),
        ({"Q": None}, BAD_INPUT, "the model has 2 states and the Q of the paper is for 6; give Q in the file"),
        ({"delta": -1.0}, BAD_INPUT, "delta is -1.0; it must be a positive number"),
        ({"A": [[1.0, 0.0], [0.0, -1.0]]}, FAILED, "stabilizable"),
        ({"delta": 0.1}, FAILED, "delta = 0.1"),
    ],
)
def test_bad_plants(command: str, changes: dict[str, Any], code: int, named: str) -> None:
    assert_refused(hfa(command, "--model", small("given.json", **changes), "-o", "result.json"), code, named)


BACKWARDS = LINEAR_STATES[::-1]


@pytest.mark.parametrize(
    ("critic", "named"),
    [
        ({"W": np.ones(20)}, "there are 20 weights; basis 'quadratic' on 6 states has 21: no basis has as many"),
        ({"W": np.ones(27)}, "has 21: name the basis of the weights, 'quadratic+linear' or 'quadratic+quartic'"),
        ({"K": np.ones((5, 6)) * 1j}, "K does not consist of rows of real numbers"),
        ({"K": np.ones((5, 6)), "states": BACKWARDS}, f"its states are in the order {', '.join(BACKWARDS)}"),
        ({"W": np.full(21, np.nan)}, "W[0] is nan; every entry must be finite"),
        ({"P": np.ones((5, 5))}, "P is 5 x 5; on a plant with 6 states it must be 6 x 6"),
        ({"K": np.ones((6, 5))}, "K is 6 x 5; on a plant with 6 states and 5 inputs it must be 5 x 6"),
        ({"gain": np.ones((5, 6))}, "there is no W, P or K"),
    ],
)
def test_bad_critics(critic: dict[str, Any], named: str) -> None:
    words = ("--dihedral", "15", "--weights", stored("given.npz", **critic), "-o", "result.json")
    assert_refused(hfa("verify", *words, "--picture", "picture.png"), BAD_INPUT, named)


@pytest.mark.parametrize(
    ("words", "named"),
    [
        ("trim --hold speed=20", ("no trim", "speed by", "ft/s^2", "throttle at its highest")),
        ("linearize --hold alpha=-15", ("no trim", "alpha by", "rad/s")),
        ("trim --limit throttle=0:30", ("no trim", "speed by", "throttle at its highest, 30")),
        ("trim --hold aileron_outer=0 --hold throttle=40", ("no trim", "dihedral_rate by", "set more free")),
        (
            "solve --delta 113.549",
            (
                "delta = 113.549 is only",
                "above delta_min = 113.5486; ask for a larger delta",
            ),
        ),
    ],
)
def test_what_has_no_solution_says_why(words: str, named: tuple[str, ...]) -> None:
    assert_refused(hfa(*words.split(), "--dihedral", "15", "-o", "result.json"), FAILED, *named)
