"""What is to be published and not yet acknowledged: in memory what comes next, in a table all of it.

Start at `outbox`, which says what goes out next; `backlog` knows where each row is, `queue` the order of one
rank, `losses` what will never come; `disk_sync` alone talks to the disk.
"""
