"""How the aircraft is controlled: the game, the critics that learn its value, and the simulated closed loop."""

from .design.controllers import design_controller as design_controller
from .design.design import load_design as load_design
from .design.design_model import design_model as design_model
from .design.scheduled_controller import (
    ScheduledController as ScheduledController,
    load_controller as load_controller,
    save_controller as save_controller,
)
from .flight.actuators import ActuatorFault as ActuatorFault, Actuators as Actuators
from .flight.envelope import Envelope as Envelope, flight_envelope as flight_envelope
from .flight.gusts import Dryden as Dryden, OneMinusCosine as OneMinusCosine
from .flight.monte_carlo import MonteCarlo as MonteCarlo
from .flight.nonlinear_flight import fly as fly
from .flight.scenario import Scenario as Scenario, Uncertainty as Uncertainty
from .game.basis import basis as basis
from .game.user_files import History as History, load_critic as load_critic, load_game as load_game
from .game.zero_sum import Game as Game, published_game as published_game
from .laws.certified import learn as learn
from .laws.certify import run as run
from .laws.recording import Stack as Stack, random_pool as random_pool, record as record
from .policy.gain_table import GainTable as GainTable
from .policy.policies import FlownLaw as FlownLaw, gain_law as gain_law
from .policy.signals import CommandSteps as CommandSteps, Signal as Signal
