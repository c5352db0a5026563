"""Detections for the frames of a recording: from a file, a bag or a built-in detector."""
