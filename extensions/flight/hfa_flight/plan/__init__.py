"""Best flights of a nonlinear aircraft, and policies that plan on the nonlinear model."""
