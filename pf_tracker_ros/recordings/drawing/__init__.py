"""A target that is drawn on a page of the browser's before tracking begins; no ROS is needed."""
