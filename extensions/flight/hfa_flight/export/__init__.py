"""Export of the aircraft and its controller to C, FMI and MATLAB."""
