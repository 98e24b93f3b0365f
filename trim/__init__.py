"""Where the aircraft flies: trim, exact linear models, modes, sweeps, and the aircraft's identification.

`trim.condition` says what a trim imposes, `trim.solve` solves it, `trim.linearize` and `trim.modes` make the linear
model, `trim.sweep` runs grids, `trim.identify` finds the aircraft behind the printed matrices.
"""
