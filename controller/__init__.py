"""How the aircraft is flown: the game, the critics that learn its value, and the closed loop."""
