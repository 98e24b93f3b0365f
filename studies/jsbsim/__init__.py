"""JSBSim's 60 aircraft: its trims and those of this project, measured in JSBSim."""
