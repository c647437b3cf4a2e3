"""The audit log: a hash chain in segment files. Start at `log`; `chain` verifies."""
