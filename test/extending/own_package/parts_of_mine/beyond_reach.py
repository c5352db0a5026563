"""A cue that needs what is not installed."""

from importlib import import_module

import_module("a_network_that_nobody_has")
