"""Topics and payloads, both ways; pure. Start at `topics` and `payloads`; `commands` reads what comes in."""
