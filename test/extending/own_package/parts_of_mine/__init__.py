"""Parts of another package; the test copies the other examples of `test/extending` here."""
