"""What `python -m stitch` is made of: maps in, joined maps out."""
