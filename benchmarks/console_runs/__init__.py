"""Runs of the console with clients of its page."""
