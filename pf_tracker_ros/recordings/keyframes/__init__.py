"""Semi-automatic labels: boxes given at some frames, tracked from both sides in between."""
