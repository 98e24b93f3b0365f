"""Small jets of one construct each: read here and by JSBSim, compared."""
