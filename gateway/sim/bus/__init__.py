"""A simulated RS-485 line with its byte times and faults; also on a pseudo terminal. Start at `bus`."""
