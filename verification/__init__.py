"""Is it true: the exact game solution with its certificate, and everything that is checked against it."""

import sys
from typing import TYPE_CHECKING

try:
    from hfa_model.support.door import open_door
except ModuleNotFoundError:  # hfa_model is some other file or folder
    path = getattr(sys.modules.get("hfa_model"), "__file__", None)
    raise ImportError(f"{path or 'a folder'} hides the package 'hfa_model' of hfa-toolchain: rename it") from None

if TYPE_CHECKING:
    from verification.balls.steady_flights import Family as Family
    from verification.checker.checker import check_certificate as check_certificate
    from verification.critic.candidate import (
        Candidate as Candidate,
        from_gain as from_gain,
        from_stored as from_stored,
        from_value as from_value,
        from_weights as from_weights,
    )
    from verification.critic.check_result import CriticCheck as CriticCheck, check_report as check_report
    from verification.critic.critic_check import check_critic as check_critic, check_history as check_history
    from verification.critic.critic_errors import relative_error as relative_error
    from verification.experiments.configuration import section5_configuration as section5_configuration
    from verification.experiments.experiment_flights import FlightPlan as FlightPlan, simulate_plan as simulate_plan
    from verification.experiments.setting import make_setting as make_setting
    from verification.flights.flight_figures import flight_figure as flight_figure
    from verification.flights.recoverable import recoverable_map as recoverable_map
    from verification.flights.scheduling import certified_schedule as certified_schedule
    from verification.meaning.linear_flight import simulate as simulate
    from verification.meaning.margins import loop_margins as loop_margins
    from verification.meaning.solution_report import analyse_game as analyse_game
    from verification.physics.lagrangian import mechanical_energy as mechanical_energy
    from verification.proof.lpv_grid import coarsest_grid as coarsest_grid
    from verification.proof.rate_proof import prove_rate as prove_rate
    from verification.proof.schedule_proof import prove_schedule as prove_schedule
    from verification.proof.solution_proof import prove_critic as prove_critic, prove_solution as prove_solution
    from verification.published.judged_critic import JudgedCritic as JudgedCritic, judged_critic as judged_critic
    from verification.published.regeneration import (
        RegeneratedPair as RegeneratedPair,
        Regeneration as Regeneration,
        regenerate_all as regenerate_all,
    )
    from verification.riccati.existence import minimum_delta as minimum_delta
    from verification.riccati.feedforward import (
        exosystem_feedforward as exosystem_feedforward,
        paper_reference as paper_reference,
    )
    from verification.riccati.frequency_response import (
        bounded_real_gain as bounded_real_gain,
        disk_margin as disk_margin,
    )
    from verification.riccati.gare import GameSolution as GameSolution, solve_game as solve_game
    from verification.riccati.gare_batch import solve_games as solve_games
    from verification.riccati.output_feedback import (
        OutputGame as OutputGame,
        minimum_output_delta as minimum_output_delta,
        solve_output_feedback as solve_output_feedback,
    )
    from verification.servo.reference_model import reference_servo as reference_servo
    from verification.validation.comparison import Validation as Validation, validate as validate
    from verification.validation.outside import released_trims as released_trims

__getattr__, __dir__, __all__ = open_door(__name__)
