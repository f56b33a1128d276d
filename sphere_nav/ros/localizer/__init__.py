"""What the nodes of both localizers share: inputs, outputs, peers."""
