"""The view in parts, each asked for itself: where most of a place has changed, a few unchanged parts still hold it."""
