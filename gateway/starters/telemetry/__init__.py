"""Who answers at a starter's address."""
