"""Tensions along paths and motions, and the compliance they leave."""
