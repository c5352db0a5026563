"""What several tests of the tracker's node need: quick parameters, parts of its messages."""

# Parameters, where the tracker does not matter.
QUICK = {"preset": "li2007", "particles": 20, "image_reliability": "reliable"}
# With a box in each frame.
NEVER_OCCLUDED = {**QUICK, "track__wrong_box_cost": 0.0}


def ids(status):
    """The ids of the targets in a status."""
    return [int(one.values["id"]) for one in status.targets]


def corner(message):
    """The upper left corner of a published box."""
    return message.polygon.points[0].x, message.polygon.points[0].y
