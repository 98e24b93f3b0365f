"""Servos: the certified controllers of a design, their loops, corners and tuning; flights through commands."""
