"""Runs of the tracker node beside a bare subscriber, each kind of measurement in a file."""
