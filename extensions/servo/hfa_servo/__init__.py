"""Subjects of the design of a controller: the aircraft with actuators, integrals of outputs and
weights."""
