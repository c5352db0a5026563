"""The replay publisher `replay`."""
