"""Reader of JSBSim's XML files as a `Model`. JSBSim itself is not needed.

The meaning of a file is that of JSBSim 1.3.3; comments name its source files, such as `FGTable`.
`aircraft.py` combines the parts; `docs/jsbsim.md` lists the supported elements.
"""
