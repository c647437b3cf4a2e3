"""`demo` and `simulate`: simulated starters, with a broker and the gateway or alone. Start at either."""
