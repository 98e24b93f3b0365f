"""Linear models at an operating point: exact derivatives, modes, error bands, comparison with the
print."""
