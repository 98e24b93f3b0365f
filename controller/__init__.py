"""How the aircraft is controlled: the game, the critics that learn its value, and the simulated closed loop."""

import sys
from typing import TYPE_CHECKING

try:
    from hfa_model.support.door import open_door
except ModuleNotFoundError:  # hfa_model is some other file or folder
    path = getattr(sys.modules.get("hfa_model"), "__file__", None)
    raise ImportError(f"{path or 'a folder'} hides the package 'hfa_model' of hfa-toolchain: rename it") from None

if TYPE_CHECKING:
    from controller.design.design import Actuator as Actuator, Design as Design
    from controller.design.design_file import load_design as load_design
    from controller.design.design_model import DesignModel as DesignModel, design_model as design_model
    from controller.design.scheduled_controller import (
        ScheduledController as ScheduledController,
        load_controller as load_controller,
        save_controller as save_controller,
    )
    from controller.flight.actuators import ActuatorFault as ActuatorFault, Actuators as Actuators
    from controller.flight.envelope import Envelope as Envelope, flight_envelope as flight_envelope
    from controller.flight.gusts import (
        Dryden as Dryden,
        OneMinusCosine as OneMinusCosine,
        side_by_side as side_by_side,
        spanwise_dryden as spanwise_dryden,
    )
    from controller.flight.scenario import Scenario as Scenario
    from controller.flight.simulate import fly as fly
    from controller.flight.uncertain import Uncertainty as Uncertainty
    from controller.game.basis import Basis as Basis, basis as basis
    from controller.game.critic_file import load_critic as load_critic, load_history as load_history
    from controller.game.history import History as History
    from controller.game.learning_result import LearningResult as LearningResult
    from controller.game.model_file import load_game as load_game
    from controller.game.zero_sum import Game as Game, published_game as published_game
    from controller.laws.certified import CertifiedSettings as CertifiedSettings
    from controller.laws.integral_rl import IrlSettings as IrlSettings
    from controller.laws.learn import LAWS as LAWS, learn as learn
    from controller.laws.published_law import PublishedSettings as PublishedSettings
    from controller.laws.run import Process as Process, Run as Run, run as run
    from controller.monte_carlo.monte_carlo_plan import MonteCarlo as MonteCarlo
    from controller.monte_carlo.stored_members import stream_monte_carlo as stream_monte_carlo
    from controller.policy.commands import CommandedStates as CommandedStates, CommandSteps as CommandSteps
    from controller.policy.flown_law import FlownLaw as FlownLaw, gain_law as gain_law
    from controller.policy.gain_table import GainTable as GainTable, load_gains as load_gains
    from controller.policy.servo_policy import servo_law as servo_law
    from controller.policy.signals import Harmonic as Harmonic, Signal as Signal
    from controller.samples.recording import Stack as Stack, random_pool as random_pool, record as record

__getattr__, __dir__, __all__ = open_door(__name__)
