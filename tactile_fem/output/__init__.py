"""What is made of a scan's results: figures, pictures, films; and input decks."""
