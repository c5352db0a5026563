"""Generated scenes: rendered footage with exact ground truth, the same bits for the same seed.

A scene is a `Stage` (a backdrop, actors that move over it, a foreground that hides them) seen by a
`HandheldCamera`. `street`, `trees` and `walkers` draw what can stand on a stage; a scene such as
`UmbrellaScene` or `ClutteredStreet` puts them together and knows the ground truth.
"""

from scenes.clutter import ClutteredStreet
from scenes.umbrellas import UmbrellaScene

__all__ = ["ClutteredStreet", "UmbrellaScene"]
