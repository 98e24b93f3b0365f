"""Small JSBSim jets with one construct each, evaluated by this project and by JSBSim."""
