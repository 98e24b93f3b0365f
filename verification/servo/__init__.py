"""Servos compared: flights through commands and actuator faults, law by law."""
