"""`hfa report`: trims, linear models and games on one HTML page."""
