"""What is to be published and not yet acknowledged, in memory and on the disk.

Start at `outbox`; `backlog` keeps the order, `segment` is one queue of it, `disk_sync` writes it to the disk.
"""
