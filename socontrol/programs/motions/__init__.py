"""Motions in time: implicit steps, conditions, simulation."""
