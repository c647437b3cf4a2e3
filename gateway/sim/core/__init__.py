"""What all simulated starters have: a motor, a power section, registers that are asked for."""
