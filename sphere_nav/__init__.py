"""The library that every node and command of the package stands on, in rooms on floors (docs/architecture.md)."""
