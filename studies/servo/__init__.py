"""Servo controllers under commands, actuator faults and gusts.

README.md describes the study.
"""
