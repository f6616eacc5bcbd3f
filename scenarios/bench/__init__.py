"""Speed and memory, measured where they are claimed."""
