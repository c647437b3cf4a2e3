"""`report` and `history`: what is stored of a motor and its starter, to read or exported. Start at either."""
