"""The independent look at an answer, on numbers of its own."""
