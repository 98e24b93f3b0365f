"""The commands of the core. Each is a function with declared options (`Command`).

`hfa.entry_points.CORE` lists the commands.
"""
