"""Parameters that the printed matrices determine, and their accuracy."""
