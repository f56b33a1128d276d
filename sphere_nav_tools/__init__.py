"""The roof: the command `sphere_nav` and what it does with bags and maps. Nothing imports it (docs/architecture.md)."""
