"""What outlives a run: SQLite, the command ledger, the outbox's file, JSON files, the audit log.

Start at `state_dir`; `worker` is the thread that writes.
"""
