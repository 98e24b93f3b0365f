"""The plant in air: actuators, commands under way, gusts, turbulence, and their scenario."""
