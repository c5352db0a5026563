"""Positions of the tracker's targets over time, from its boxes and the sensors beside it.

Shared by the node `localizer` and by `track --world`. No part of it imports ROS.
"""
