"""One simulated flight: plant, policy, signals, actuators and gusts in one loop."""
