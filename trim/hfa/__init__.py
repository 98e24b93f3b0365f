"""What trims and linear models of the paper's aircraft alone have: bands of the print, loads on its
panels."""
