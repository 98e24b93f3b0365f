"""The exact game solution and its analysis, which the checks compare with, offered under the
package's own name."""

from controller.riccati.frequency_response import bounded_real_gain as bounded_real_gain
from controller.riccati.game_batch import solve_games as solve_games
from controller.riccati.gare import (
    Solution as Solution,
    solve_game as solve_game,
)
from controller.riccati.margins import disk_margin as disk_margin
from controller.riccati.smallest_delta import minimum_delta as minimum_delta
from controller.riccati.solution_report import analyse_game as analyse_game
