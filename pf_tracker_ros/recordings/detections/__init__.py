"""What a detector says of the frames of a recording: from a file, from a bag, or from one here."""
