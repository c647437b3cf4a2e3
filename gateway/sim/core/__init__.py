"""The common part of all simulated starters: a motor, a power section, registers. Start at `unit`."""
