"""The main job on one page that an engineer files: trims, models, games and claims, one HTML
file."""
