"""A cue with a dependency that is not installed."""

from importlib import import_module

import_module("a_network_that_nobody_has")
