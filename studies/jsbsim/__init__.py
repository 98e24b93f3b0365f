"""JSBSim's 60 aircraft: its trims, ours, and ours measured in JSBSim."""
