"""Features for the paper's aircraft (HFA): printed matrices, error bands and front view."""
