"""Studies over many seeds and scenarios: what each ingredient is worth, with intervals."""
