"""The simulated SSW900. Start at `unit`."""
