"""One simulated flight: plant, policy, actuators and gusts in one loop."""
