"""What any service of this kind needs; knows nothing of starters.

Time: `clock`. Work that fails or stalls: `supervised`, `stalls`. Rates, what is said once, and
back-off: `rate_limits`. The machine: `systemd`, `log_thread`, `gc_tuning`, `instance_lock`, `whole_files`,
`key_pair`.
"""
