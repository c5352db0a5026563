"""Decodes image messages to arrays."""
