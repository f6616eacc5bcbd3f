"""What others do: the aligners of the literature."""
