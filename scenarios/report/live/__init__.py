"""What the live map of the page is told about a run: plain JSON with packed arrays."""
