"""Clock, systemd, logging, rate limits: what any program of this kind needs; knows nothing of starters."""
