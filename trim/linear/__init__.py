"""Linear models at an operating point: exact derivatives, modes and transfer functions."""
