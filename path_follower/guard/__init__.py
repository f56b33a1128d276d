"""Commands pass while they come and while their sender lives, else zero."""
