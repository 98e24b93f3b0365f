"""Many flights with random errors, noise and turbulence."""
