"""Questions about a robot as mathematical programs, their solution, and the independent look at the answer."""
