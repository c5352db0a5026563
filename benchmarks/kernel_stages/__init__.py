"""What a frame is made of, each stage timed beside a floor of the same run."""
