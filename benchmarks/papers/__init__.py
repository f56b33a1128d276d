"""What `python -m benchmarks.papers` is made of: drives and curves of the papers, and the form of a result."""
