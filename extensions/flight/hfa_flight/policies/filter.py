"""`hfa.filter`: the Kalman filter of an aircraft, and policies of its estimate."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from hfa_flight.air.scenario import Scenario
from hfa_flight.air.sensors import Sensor
from hfa_flight.air.turbulence import Turbulence
from hfa_flight.policies.filtered_policy import FilteredPolicy
from hfa_flight.policies.given import policy_and_scenario
from hfa_flight.policies.kalman import KalmanFilter
from hfa_flight.policies.policy import Policy
from trim.linear.linear_model import LinearModel


class Filter(KalmanFilter):
    """Kalman filter that policies may stand behind."""

    def policy(self, law: Any, *, fade: float | None = None) -> FilteredPolicy:
        """Return the policy U = law(estimate), sampled and saturated at the control limits.

        The result is a policy: `policy(t, y) -> U`, `reset()`, and an argument of `hfa.fly`.

        law: a gain K, a critic, a solution, a deployment or another policy that `hfa.fly` accepts
        fade: time in which commands are faded in where the filter is switched on in flight, s.
            Default: 1; 3 for a gain with which the filter alone, without the aircraft, is unstable

        Raises BadInputError for a policy without feedback, or with another sample time, and for a
        negative fade.
        """
        sampled = Scenario(tick=self.dt, step=self.dt, duration=self.dt)
        if not isinstance(law, Policy):
            law, _ = policy_and_scenario(law, self.point, sampled)
        return FilteredPolicy.behind(self, law, fade)


def filter(  # the field's word, although a builtin has it
    linear: LinearModel,
    noise: Mapping[str, float | Sensor],
    turbulence: Turbulence | str | None = None,
    dt: float = 0.01,
) -> Filter:
    """Return the Kalman filter of an aircraft near a trim: the stationary one, from which the
    extended one of a flight begins.

      x⁺ = Φ x + Γ u + w,  y = C x + n,  P = Φ (P - P C'(C P C' + R)⁻¹ C P) Φ' + Q

    x contains the states of the Dryden or von Karman filters of the turbulence, and the biases of
    the sensors that have one, random walks of an hour.

    linear: linear model at the trim
    noise: what is measured, a linear state or an output of the model (airspeed, angle_of_attack and
      sideslip of every aircraft in gusts) -> standard deviation of its noise in a sample, in its
      unit, or `Sensor`. A linear state without noise has no sensor
    turbulence: turbulence as in `hfa fly`, such as "moderate:40000", or None for still air
    dt: sample time, s

    Each linear state drifts, unmodeled, by .1 times its noise in one second (standard deviation);
    without a sensor by .001 times its nominal value.

    Raises BadInputError for a wrong argument, and for a mode that does not decay and that the
    sensors do not observe. Raises NoSolutionError if the Riccati equation is not solved.

    Source: Anderson, Moore, *Optimal Filtering*, 1979, Chapters 3 and 4.

    >>> import hfa
    >>> model = hfa.aircraft()
    >>> linear = hfa.linearize(model, hfa.trim(model))
    >>> noise = {"speed": .3, "pitch": .002, "pitch_rate": .003, "dihedral": .002}
    >>> hfa.filter(linear, noise, "light:20000").radius < 1.0
    True
    """
    return Filter.of(linear, noise, turbulence, dt)
