"""The folder of a run: everything that was asked, measured and answered, written and read back."""
