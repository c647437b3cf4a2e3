"""What all simulated starters have: a motor, a power section, registers. Start at `unit`."""
