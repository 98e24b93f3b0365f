"""Laws that plan on the nonlinear model (`hfa_flight.plan`)."""

from __future__ import annotations

#: Law that plans a flight at each sample.
PREDICTIVE = "predictive"
#: Names of all laws.
LAWS = (PREDICTIVE, "state-dependent")
#: Kinds of files that contain a policy.
GAIN = "a gain or critic"
NETWORK = "a network"
TABLE = "a gain table"
DEPLOYMENT = "a deployment"
