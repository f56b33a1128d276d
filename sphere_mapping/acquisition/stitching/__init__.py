"""Images of one instant -> one sphere."""
