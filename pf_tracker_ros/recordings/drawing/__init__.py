"""Drawing targets on a web page before tracking begins, without ROS."""
