"""What is made of a scan's results: figures, pictures, films, reports; and input decks."""
