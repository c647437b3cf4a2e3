"""What a line can keep: load, sweep, watchdogs, gaps after an outage; pure.

Start at `forecast`.
"""
