"""Parameters that were: what is to be used in their place, or why there is nothing."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

_RENAMED = {
    "motion.affine_factor": "motion.factor",
    "motion.affine_drift_x": "motion.drift",
    "motion.affine_drift_y": "motion.drift",
    "proposal.search_window": "proposal.window",
    "foreground_probability.power": "color_contrast.power",
    "foreground_probability.sharpness": "color_contrast.sharpness",
    "foreground_probability.keep": "color_contrast.keep",
    "moving_foreground.power": "foreground.power",
    "moving_foreground.sharpness": "foreground.sharpness",
    "oriented_gradients.power": "hog.power",
    "oriented_gradients.sharpness": "hog.sharpness",
}
# What nobody varied, and no measurement showed to matter.
_FIXED: Mapping[str, object] = {
    "nominal_interval": "0.04 s; give the tracker the time between frames",
    "motion.velocity_damping": 0.0,
    "motion.prior_position": 0.05,
    "motion.prior_velocity": "0.5, and 0.2 in affine motion",
    "motion.model_step": "0.04 s",
    "proposal.search_cells": 48,
    "proposal.jump_probability": 0.1,
    "color_histogram.levels": 16,
    "gradient_orientation.cells": 4,
    "gradient_orientation.directions": 8,
    "gradient_orientation.gaussian_width": 0.5,
    "foreground_probability.levels": 16,
    "foreground_probability.ring": 0.4,
    "moving_foreground.ring": 0.3,
    "background.samples": 20,
    "background.radius": 20,
    "background.matches": 2,
    "background.update_every": 16,
    "background.reduction": 2,
    "background.color": "true",
    "oriented_gradients.cells_x": 5,
    "oriented_gradients.cells_y": 6,
    "oriented_gradients.bins": 16,
    "oriented_gradients.smoothing": "true",
    "correlation_response.cells": 40,
    "correlation_response.sizes": 2,
    "correlation_response.size_step": 1.04,
    "correlation_response.memory": 300.0,
    "correlation_response.training_interval": 3,
    "correlation_response.settling_frames": 25,
    "fusion.adaptation_rate": 0.1,
    "template.settling_frames": 40,
    "redetection.accept_above": 0.7,
}
_ADAPTED = "the number of particles is 'particles'; adapting it brought nothing"
_GONE = {
    "proposal.kalman_share": "choose 'kalman' for 'proposal.method', with 'proposal.share'",
    "proposal.search_share": "choose 'search' for 'proposal.method', with 'proposal.share'",
    "track.coast": "choose 'coast' or 'follow' for 'track.while_hidden'",
    "adaptive_number.error": _ADAPTED,
    "adaptive_number.fewest": _ADAPTED,
    "adaptive_number.bin_size": _ADAPTED,
    "resampling.keep_best": "choose 'multinomial_keeping_best' for 'resampling.scheme'",
    "color_histogram.foreground_only": (
        "choose 'foreground_color_histogram' in place of 'color_histogram' in 'cues'"
    ),
    "foreground_probability.own_size": (
        "the contrast is measured in the size that the target is expected in"
    ),
    "template.keep": ("each cue has its own, such as 'color_histogram.keep' or 'hog.keep'"),
}


def _former_names() -> Iterator[tuple[str, str]]:
    yield from _RENAMED.items()
    for name, value in _FIXED.items():
        yield name, f"it is fixed at {value}"
    yield from _GONE.items()


# Full name to the full name of another parameter, or to a reason.
FORMER_NAMES: Mapping[str, str] = dict(_former_names())
