"""The simulated SSW-06, SSW-07 and SSW-08."""
