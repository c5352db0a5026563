"""The node `console`: a web page that shows what the tracker sees, and drives it."""
