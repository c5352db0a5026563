"""Runs of the tracker node and a bare subscriber, a module for each kind of measurement."""
