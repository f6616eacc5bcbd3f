"""The studies, one file each: each has a function ``run(options)``."""
