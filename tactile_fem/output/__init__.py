"""Output of a scan: figures, pictures, animations; and input decks."""
