"""One pass over the pixels of a reference: warp, compare, weigh, sum."""
