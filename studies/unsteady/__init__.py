"""Servo designs and tolerated gusts on the `unsteady` dynamics, compared with other dynamics."""
