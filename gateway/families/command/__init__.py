"""Verbs, interlocks and writes of all families. Start at `build`."""
