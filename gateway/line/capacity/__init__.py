"""What a line can keep: load, sweep, watchdogs, estimated ages, gaps after an outage; pure.

Start at `forecast`.
"""
