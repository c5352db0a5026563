"""Shared by the web pages of this package: access control, serving, the box editor."""
