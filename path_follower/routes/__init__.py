"""Taught paths of one map as a network: edges driven alike, branches, places; the way through it, and onto it.

`building.py` makes the network from paths, `network_file.py` keeps it, `planning.py` finds a way and makes one path
of it, `mission.py` is what a vehicle does with it.
"""
