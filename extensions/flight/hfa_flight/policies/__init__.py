"""Policies that fly: gains, schedules, controllers and deployments."""
