"""Parts of another package; the others of `test/extending` are copied beside them."""
