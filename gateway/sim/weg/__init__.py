"""The simulated SSW-06, SSW-07 and SSW-08, one file each. Start at `common`, which they share."""
