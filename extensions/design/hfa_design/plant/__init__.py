"""Certified H-infinity control of a generalized plant."""
