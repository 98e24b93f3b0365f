"""What others have printed and released about the same aircraft, beside the model."""
