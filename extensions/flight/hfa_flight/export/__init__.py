"""The aircraft and its controller for other tools: C, FMI, MATLAB."""
