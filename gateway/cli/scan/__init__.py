"""`scan`: which starters answer on a port, with which rate and framing. Start at `scan`."""
