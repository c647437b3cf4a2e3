"""The simulated SST130i, SST330i and SST360i. Start at `unit`."""
