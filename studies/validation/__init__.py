"""Published and released data of the same aircraft, compared with the model."""
