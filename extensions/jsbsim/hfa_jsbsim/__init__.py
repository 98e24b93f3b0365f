"""Conversion of JSBSim's XML files to a `Model`. JSBSim need not be installed.

Files are interpreted as in JSBSim 1.3.3. Names such as `FGTable` in comments are its source
files. `aircraft.py` combines the parts. `docs/aircraft.md` lists the supported elements.
"""
