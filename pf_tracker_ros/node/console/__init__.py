"""The node `console`: a web page that shows the tracker's output and controls it."""
