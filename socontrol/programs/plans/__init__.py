"""Trajectories by direct collocation."""
