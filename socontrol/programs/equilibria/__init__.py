"""Where a robot rests: scaled Newton steps under loads, held lengths and closed loops, and whether it stays there."""
