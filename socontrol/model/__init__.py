"""What a robot is: segments as frozen records, and the tree of pieces they become."""
