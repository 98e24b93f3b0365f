"""Linear models at an operating point: exact derivatives, modes, transfer functions, responses."""
