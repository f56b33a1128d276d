"""What `python -m benchmarks.papers` is made of: drives of the papers, curves of the papers, and the form of a result."""
