"""Trims, exact linear models and games of aircraft, and critics checked against the exact
solution."""

from controller.critic.critic import (
    Critic as Critic,
    from_gain as from_gain,
    from_value as from_value,
    from_weights as from_weights,
)
from controller.critic.critic_file import read_critic as read_critic
from controller.critic.network.critic import from_network as from_network
from controller.critic.training_run import TrainingRun as TrainingRun
from controller.expansion.expansion import Expansion as Expansion, expand as expand
from controller.game.linear_game import game as game
from controller.game.zero_sum import Game as Game
from controller.learning.laws import learn as learn
from controller.riccati.gare import (
    Solution as Solution,
    lqr as lqr,
    margins as margins,
    solve as solve,
)
from controller.tracking import track as track
from hfa.options.trims import conditions as conditions
from hfa_aircraft.loading import load_model as load_model
from hfa_aircraft.model import Model as Model
from hfa_aircraft.readers.derivatives.read import from_derivatives as from_derivatives
from hfa_aircraft.servos import Servo as Servo, with_servos as with_servos
from hfa_aircraft.signals import Signal as Signal
from hfa_flight.air.scenario import Scenario as Scenario
from hfa_flight.air.sensors import Sensor as Sensor
from hfa_flight.air.turbulence import Turbulence as Turbulence
from hfa_flight.judge.assessment import Assessment as Assessment, assess as assess
from hfa_flight.learn.environment import environment as environment
from hfa_flight.plan.best_flight import BestFlight as BestFlight
from hfa_flight.plan.predictive import predictive as predictive
from hfa_flight.plan.starts_table import optimize as optimize
from hfa_flight.plan.state_dependent import (
    keep_inside as keep_inside,
    state_dependent as state_dependent,
)
from hfa_flight.policies.deployment.deployment import Deployment as Deployment
from hfa_flight.policies.filter import filter as filter
from hfa_flight.samples.fly import FlightsInAir as FlightsInAir, fly as fly
from hfa_flight.simulate.flight import Flight as Flight
from hfa_identify.estimation import identify as identify
from hfa_model.choice import aircraft as aircraft
from hfa_support.errors import BadInputError as BadInputError, NoSolutionError as NoSolutionError
from trim.linear.linear_model import LinearModel as LinearModel
from trim.linear.linearize import linearize as linearize
from trim.point.condition import TrimCondition as TrimCondition
from trim.point.operating_point import OperatingPoint as OperatingPoint
from trim.point.solve import trim as trim
from trim.sweeps.result import Sweep as Sweep
from trim.sweeps.sweep import sweep as sweep
from verification.critic_check import verify as verify
from verification.verdict import Verdict as Verdict

from . import paper as paper

__version__: str
