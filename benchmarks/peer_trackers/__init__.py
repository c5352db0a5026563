"""Trackers of other libraries behind one interface, for the comparison in `peers.py`.

One file a library; each tracker runs as its library ships it, save where its docstring says so.
"""

from peer_trackers.color_particle_filter import ColorParticleFilter
from peer_trackers.dlib_correlation import DlibCorrelation
from peer_trackers.multiple_instance_learning import MultipleInstanceLearning
from peer_trackers.network_alone import NetworkAlone
from peer_trackers.opencv_trackers import (
    ChannelSpatialReliability,
    KernelizedCorrelation,
    NanoTrack,
)
from peer_trackers.peer import PeerTracker

PEERS: tuple[type[PeerTracker], ...] = (
    ChannelSpatialReliability,
    KernelizedCorrelation,
    MultipleInstanceLearning,
    DlibCorrelation,
    ColorParticleFilter,
)
"""Those that need no files of their own; `NanoTrack` and `NetworkAlone` do."""

__all__ = ["PEERS", "ChannelSpatialReliability", "NanoTrack", "NetworkAlone", "PeerTracker"]
