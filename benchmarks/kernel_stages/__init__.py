"""The stages of a frame, each timed with a lower bound from the same run."""
