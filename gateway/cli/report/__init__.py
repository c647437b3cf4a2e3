"""`report`: how a motor and its starter do, for the terminal or as a page to print. Start at `report`."""
