"""Positions in meters: one file for each recording or scene, with its reader and its table."""
