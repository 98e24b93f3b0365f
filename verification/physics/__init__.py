"""The equations of motion derived a second time."""
