"""Data shared by learners and checks: games, bases, files and training runs, without algorithms."""
