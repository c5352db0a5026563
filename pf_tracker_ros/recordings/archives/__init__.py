"""Archives: many recordings, each once, over processes of this machine or a Ray cluster."""
