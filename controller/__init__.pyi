"""How the aircraft is controlled: the game, the critics that learn its value, and the simulated
closed loop."""

from hfa_flight.actuators import ActuatorBank as ActuatorBank, ActuatorFault as ActuatorFault
from hfa_flight.envelope import flight_envelope as flight_envelope
from hfa_flight.flight_figure import flight_figure as flight_figure
from hfa_flight.gain_schedule import GainSchedule as GainSchedule
from hfa_flight.gusts import Dryden as Dryden, OneMinusCosine as OneMinusCosine
from hfa_flight.monte_carlo import MonteCarlo as MonteCarlo
from hfa_flight.monte_carlo_store import (
    run_monte_carlo as run_monte_carlo,
)
from hfa_flight.nonlinear_flight import fly as fly
from hfa_flight.policies import GainPolicy as GainPolicy, Policy as Policy
from hfa_flight.scenario import Scenario as Scenario, Uncertainty as Uncertainty
from hfa_flight.signals import CommandSteps as CommandSteps, Waveform as Waveform
from hfa_servo.controllers import design_controller as design_controller
from hfa_servo.design import load_design as load_design
from hfa_servo.design_model import design_model as design_model
from hfa_servo.scheduled_controller import (
    ScheduledController as ScheduledController,
    load_controller as load_controller,
    save_controller as save_controller,
)

from .critic.critic_file import critic_in as critic_in
from .critic.critic_history import critics_over_time as critics_over_time
from .game.basis import basis as basis
from .game.zero_sum import Game as Game
from .hfa_files import load_game as load_game
from .hfa_game import published_game as published_game
from .learning.certified import learn as learn
from .learning.recording import Stack as Stack, random_pool as random_pool, record as record
from .learning.ticks import run as run
