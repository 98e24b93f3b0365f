"""Why a critic is wrong: the mistake, or the other game, which its numbers show."""
