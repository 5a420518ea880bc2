"""Rotations, poses, twists and screws: SO(3) and SE(3), their exponentials, logarithms and tangent maps.

Twists are [angular; linear] and wrenches [moment; force], both in the body frame; a pose maps body
coordinates to parent coordinates, and poses compose by cancelling letters, g_wc = g_wb @ g_bc. Every function
is a plain casadi expression that serves DM, SX and MX alike, with right values and derivatives of every order
at zero rotation; `screws` alone asks for numbers.
"""
