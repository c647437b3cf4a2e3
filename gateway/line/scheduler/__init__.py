"""Which request is next; pure. Start at `scheduler`."""
