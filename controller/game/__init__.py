"""What learning and checking share: the game, the basis, the files and the result; no algorithm."""
