"""The data of the live map, as the page reads it."""
