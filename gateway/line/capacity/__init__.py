"""What a line can keep: load, sweep, ages, watchdogs, gaps after an outage; pure. Start at `forecast`."""
