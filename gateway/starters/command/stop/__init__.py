"""The stop of one starter, of a group, and of a start that did not act. Start at `machine`."""
