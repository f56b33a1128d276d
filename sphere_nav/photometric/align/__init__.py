"""One image against references: projection, overlap, ESM from coarse to fine, for one camera or several."""
