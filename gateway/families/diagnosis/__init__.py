"""Who answers, and what its settings mean for its operation. Start at `identify` and `readiness`."""
