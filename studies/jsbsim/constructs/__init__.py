"""Small jets with one construct each, read by this project and by JSBSim and compared."""
