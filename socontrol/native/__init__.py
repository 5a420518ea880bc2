"""What runs on this machine as machine code: a C compiler, a cache of what it made, calls without copies."""
