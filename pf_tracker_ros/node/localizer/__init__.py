"""The node `localizer`: the tracker's targets in meters."""
