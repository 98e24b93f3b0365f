"""Both printed pairs regenerated and checked; a critic learned and compared in one call."""
