"""The common data of learning and checking: the game, the basis, the files and the result; no
algorithm."""
