"""What a controller is designed for: the aircraft with actuators, integrals of outputs and
weights."""
