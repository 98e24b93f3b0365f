"""Networks as critics: their files read, their errors searched and proved."""
