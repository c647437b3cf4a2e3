"""`simulate`: simulated starters on pseudo terminals or TCP. Start at `simulate`."""
