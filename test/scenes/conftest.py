"""Scenes that several tests look at."""

import pytest
from scenes import UmbrellaScene


@pytest.fixture(scope="session", params=[0, 1, 2])
def scene(request):
    """The umbrella scene as it comes."""
    return UmbrellaScene(request.param)


@pytest.fixture(scope="session", params=[0, 1])
def bare_scene(request):
    """The umbrella scene without the sensor's noise and the drift of the light."""
    return UmbrellaScene(request.param, {"noise": 0.0, "lighting": 0.0})
