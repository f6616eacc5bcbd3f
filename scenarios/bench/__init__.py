"""Speed, memory and matching, measured where they are claimed."""
