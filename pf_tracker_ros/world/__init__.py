"""Direction, position and velocity of targets from their boxes and a calibrated camera.

No part of it imports ROS. `docs/world.md` explains geometry, conventions and accuracy.
"""

from pf_tracker_ros.world.camera_model import CameraModel
from pf_tracker_ros.world.ground_from_people import PeopleGround, fit_ground_plane
from pf_tracker_ros.world.ground_plane import GroundPlane
from pf_tracker_ros.world.localizer import METHODS, Localizer
from pf_tracker_ros.world.place import Bearing, Place, in_fixed_frame
from pf_tracker_ros.world.position_filter import FilteredPosition, PositionFilter

__all__ = [
    "METHODS",
    "Bearing",
    "CameraModel",
    "FilteredPosition",
    "GroundPlane",
    "Localizer",
    "PeopleGround",
    "Place",
    "PositionFilter",
    "fit_ground_plane",
    "in_fixed_frame",
]
