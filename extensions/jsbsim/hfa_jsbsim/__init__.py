"""Aircraft of JSBSim as a `Model`: their XML files are read, JSBSim itself is not needed.

What a file means is JSBSim's own (version 1.3.3): the comments name its source files, `FGTable` for
one. `aircraft.py` puts the parts together; `docs/jsbsim.md` says what is read and what is not.
"""
