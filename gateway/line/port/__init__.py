"""Ports: serial and TCP, opened, read and written on time. Start at `base` and `opener`."""
