"""Nonlinear programs: declared by name, scaled, handed to Ipopt or fatrop with exact derivatives."""
