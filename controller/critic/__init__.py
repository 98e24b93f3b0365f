"""Critics: learned values and policies as functions of the state, and how they are read from
files."""
