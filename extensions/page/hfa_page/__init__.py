"""`hfa report`: trims, linear models, games and the paper's claims on one HTML page."""
