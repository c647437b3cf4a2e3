"""What a starter's settings mean for its operation. Start at `readiness`."""
