"""Small JSBSim jets that contain one construct each, evaluated by this project and by JSBSim.

A construct is a feature of JSBSim's file format, for example a table or a filter.
"""
