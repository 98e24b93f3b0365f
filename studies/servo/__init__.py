"""Servos through commands, actuator faults and gusts, and the search for their weights; see
README.md."""
