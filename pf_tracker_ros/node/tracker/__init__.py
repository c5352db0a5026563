"""The node `pf_tracker`."""
