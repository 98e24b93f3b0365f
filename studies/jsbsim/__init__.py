"""Trims of JSBSim's 60 aircraft by JSBSim and by this project, evaluated in JSBSim."""
