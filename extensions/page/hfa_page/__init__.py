"""The main job on one HTML page: trims, models, games and claims."""
