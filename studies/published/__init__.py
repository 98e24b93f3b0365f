"""Published solutions of games, checked digit by digit."""
