"""The node `watch`: boxes and positions as lines of text."""
