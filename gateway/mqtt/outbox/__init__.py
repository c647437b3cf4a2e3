"""What is to be published and not yet acknowledged, in memory and on the disk.

Start at `outbox`; `backlog` keeps the order, `segment` one queue of it, `disk_sync` moves it to the disk.
"""
