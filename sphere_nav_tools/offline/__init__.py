"""What several commands do: recordings through the callbacks of the nodes, without an executor."""
