"""`history`: the recorded starts and trips of a starter, listed or exported. Start at `history`."""
