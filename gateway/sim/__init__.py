"""Simulated starters, for the demo, `simulate` and the tests. Start at `factory`."""
