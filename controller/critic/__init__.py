"""Critics: learned values and policies as functions of the state, and their files."""
