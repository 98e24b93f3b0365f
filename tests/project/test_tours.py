"""The two tours of ARCHITECTURE.md: what they name is what runs."""

from __future__ import annotations

import re
import sys
from pathlib import Path
from types import FrameType

import pytest
from cli import hfa
from game_files import stored
from import_graph import LAYERS, ROOT

from controller import Game, basis
from hfa_cli.main import DONE
from verification import solve_game
from verification.riccati import gare
from verification.riccati.certificate import certified_solution

TOURS = (ROOT / "ARCHITECTURE.md").read_text(encoding="utf-8").partition("## Two tours")[2].partition("\n## ")[0]
GUST, CRITIC = re.split(r"\nA critic's weight", TOURS)
#: All that runs of these stands in the tour of the critic.
_ROOMS = ("controller/game/", "verification/")


def stations(tour: str) -> list[str]:
    """The files on the way, those beside it left out."""
    return re.findall(r"^\d+\. `(\S+\.py)`", tour, re.MULTILINE)


def named(tour: str) -> set[str]:
    """Every file of a tour that is named with its folder."""
    return set(re.findall(r"`(\S+/\S+\.py)`", tour))


def executed(*words: str) -> set[str]:
    """Files of the project in which a command calls a function."""
    found = set()
    hfa(*words)  # what importing executes is not on the way

    def look(frame: FrameType, event: str, _: object) -> None:
        if event == "call":
            found.add(frame.f_code.co_filename)

    sys.setprofile(look)
    try:
        assert hfa(*words).code == DONE
    finally:
        sys.setprofile(None)
    paths = {Path(name).resolve() for name in found if not name.startswith("<")}
    inside = {path.relative_to(ROOT).as_posix() for path in paths if path.is_relative_to(ROOT)}
    return {path for path in inside if path.split("/")[0] in LAYERS}


def test_every_station_of_a_gust_runs() -> None:
    assert len(stations(GUST)) <= 8
    assert (
        named(GUST) - executed("fly", "--dihedral", "15", "--law", "exact", "--gust", "100:5", "--duration", "0.02")
        == set()
    )


def test_the_tour_of_a_critic_is_what_runs(tmp_path: Path, game: Game, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.chdir(tmp_path)
    monkeypatch.setattr(gare, "certified_solution", certified_solution)  # not what another test has solved
    critic = stored("critic.json", W=basis("quadratic", len(game.A)).weights(solve_game(game).P))
    ran = executed("verify", "--dihedral", "15", "--weights", critic)
    assert len(named(CRITIC)) == len(stations(CRITIC)) <= 15
    assert named(CRITIC) - ran == set()
    of_the_judge = {path for path in ran if path.startswith(_ROOMS)}
    assert of_the_judge - named(CRITIC) == set()
    left_out = "verification/riccati/frequency_response.py"
    assert of_the_judge - named(CRITIC.replace(left_out, "frequency_response.py")) == {left_out}
