"""The plant in air: commands under way, gusts, turbulence, sensors, and their scenario."""
