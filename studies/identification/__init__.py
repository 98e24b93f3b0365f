"""Which parameters the printed matrices determine, and how far to trust them."""
