"""The seven families of trackers in Zhang Bo's comparison.

They are built from OpenCV's functions in the spirit of their families; Zhang Bo cites a paper for
each and gives neither code nor parameters. All follow `FamilyTracker`: `start(image, box)`, then
`update(image)`, which answers with the box.
"""

from collections.abc import Mapping

from tracker_families.family import FamilyTracker
from tracker_families.feature_points import FeaturePoints
from tracker_families.gaussian_mixture import GaussianMixture
from tracker_families.machine_learning import MultipleInstanceLearning
from tracker_families.optical_flow import FlowClusters
from tracker_families.swarm_filter import SwarmFilter
from tracker_families.templates import DeformableTemplate, TemplateMatching

FAMILIES: Mapping[str, type[FamilyTracker]] = {
    "Gaussian mixture": GaussianMixture,
    "template matching": TemplateMatching,
    "KLT points": FeaturePoints,
    "deformable template": DeformableTemplate,
    "flow clusters": FlowClusters,
    "machine learning": MultipleInstanceLearning,
    "swarm filter": SwarmFilter,
}
"""The families in the paper's order."""
