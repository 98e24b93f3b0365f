"""Servo controllers under commands, actuator faults and gusts, and the search for their weights.

README.md describes the study.
"""
