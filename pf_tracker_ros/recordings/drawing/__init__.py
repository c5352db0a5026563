"""A web page to draw targets, to watch them being tracked and to read the report; without ROS."""
