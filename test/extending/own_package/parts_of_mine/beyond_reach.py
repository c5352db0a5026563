"""A cue that needs what is not installed."""

import a_network_that_nobody_has  # noqa: F401
