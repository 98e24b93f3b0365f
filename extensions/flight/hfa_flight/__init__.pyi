"""One simulated flight: plant, policy, actuators and gusts in one loop."""

from .actuators import ActuatorBank as ActuatorBank, ActuatorFault as ActuatorFault
from .envelope import flight_envelope as flight_envelope
from .gusts import OneMinusCosine as OneMinusCosine
from .monte_carlo import MonteCarlo as MonteCarlo
from .monte_carlo_store import run_monte_carlo as run_monte_carlo
from .policies import GainPolicy as GainPolicy, Policy as Policy
from .scenario import Scenario as Scenario, Uncertainty as Uncertainty
from .signals import CommandSteps as CommandSteps, Waveform as Waveform
