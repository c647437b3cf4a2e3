"""`demo`: a broker, simulated starters and the gateway in one terminal. Start at `demo`."""
