"""What judge and learner share: the game, the basis, the files and the result; no algorithm."""
