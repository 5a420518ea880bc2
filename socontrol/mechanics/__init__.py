"""What a robot does: poses, forces and their derivatives as expressions of q and u, and as CasADi Functions."""
