"""Archives: many recordings, tracked in parallel processes or on a Ray cluster."""
