"""A frozen set of recordings that others answer: written, scored, and all submissions side by side."""
