"""The simulation of a study, and the scan: its histories and spikes in a results folder.

Results and checks are imported without DOLFINx.
"""
