"""Standard air by the formulas of the U.S. Standard Atmosphere 1976, for numbers and expressions."""

import casadi as ca

_GAS_CONSTANT = 8314.32 / 28.9644  # J/(kg K)


def density(altitude):
    """Return the density of the air, slug/ft³, at an altitude in ft, up to 65,000 ft."""
    metres = altitude * 0.3048
    height = 6_356_766.0 * metres / (6_356_766.0 + metres)
    kelvin = 288.15 - 0.0065 * ca.fmin(height, 11_000.0)
    pressure = 101_325.0 * (kelvin / 288.15) ** (9.80665 / (_GAS_CONSTANT * 0.0065))
    pressure *= ca.exp(-9.80665 * ca.fmax(height - 11_000.0, 0.0) / (_GAS_CONSTANT * kelvin))
    return pressure / (_GAS_CONSTANT * kelvin) * 0.3048**3 / 14.593902937206364
