"""One command other than a stop: what decides, what is written, how it ends. Start at `pipeline`."""
