"""sixflow."""
