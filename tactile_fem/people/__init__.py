"""People: predictions with their spread between fingers."""
