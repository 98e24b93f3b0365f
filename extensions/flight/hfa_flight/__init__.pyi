"""One simulated flight: plant, policy and gusts in one loop."""

from hfa_aircraft.waveform import Harmonic as Harmonic, Waveform as Waveform

from .air.gust_equations import in_gusts as in_gusts
from .air.gusts import OneMinusCosine as OneMinusCosine
from .air.scenario import (
    Scenario as Scenario,
    Uncertainty as Uncertainty,
)
from .air.signals import CommandSteps as CommandSteps
from .air.turbulence import (
    AirFilter as AirFilter,
    scales_and_intensities as scales_and_intensities,
    turbulence_of as turbulence_of,
)
from .options import declared_sensors as declared_sensors
from .policies.deployment.deployed import Deployed as Deployed
from .policies.policy import (
    GainPolicy as GainPolicy,
    Measurements as Measurements,
    Policy as Policy,
)
from .samples.monte_carlo import (
    MonteCarlo as MonteCarlo,
    fly_member as fly_member,
    run_monte_carlo as run_monte_carlo,
)
from .schedule.gain_schedule import (
    GainSchedule as GainSchedule,
    load_gain_schedule as load_gain_schedule,
)
from .simulate.envelope import flight_envelope as flight_envelope
