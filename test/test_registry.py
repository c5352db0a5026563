"""Registries: parts selected by name, each registered in its own module."""

import importlib
import json
import subprocess
import sys
from dataclasses import dataclass

import pytest

from pf_tracker_ros.cues import CUES
from pf_tracker_ros.cues.features import FEATURES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
from pf_tracker_ros.parameters import declarations, declared
from pf_tracker_ros.registry import NoParameters, Registry

TIMEOUT = 60.0


@dataclass(frozen=True)
class WheelParameters:
    """Some parameters."""

    radius: float = declared(1.0, "Radius.", minimum=0.0, maximum=9.0)


@pytest.fixture
def wheels():
    registry = Registry("wheel")

    @registry.register("wooden", WheelParameters)
    class Wooden:
        pass

    @registry.register("air")
    def pumped():
        return "pumped"

    return registry, Wooden, pumped


def test_a_name_has_a_factory_and_parameters(wheels):
    registry, wooden, pumped = wheels
    assert registry["wooden"] is wooden
    assert registry["air"] is pumped
    assert pumped() == "pumped"
    assert registry.parameters_of("wooden") is WheelParameters
    assert registry.parameters_of("air") is NoParameters


def test_names_are_in_the_order_in_which_they_registered(wheels):
    registry, wooden, pumped = wheels
    registry.register("a")(pumped)
    assert list(registry) == ["wooden", "air", "a"]
    assert dict(registry) == {"wooden": wooden, "air": pumped, "a": pumped}
    assert len(registry) == 3
    assert "wooden" in registry
    assert "steel" not in registry


def test_a_name_that_is_taken_is_refused_and_keeps_its_part(wheels):
    registry, wooden, pumped = wheels
    with pytest.raises(ValueError, match="there is a wheel 'wooden' already; choose another name"):
        registry.register("wooden")(pumped)
    assert registry["wooden"] is wooden
    assert registry.parameters_of("wooden") is WheelParameters
    assert list(registry) == ["wooden", "air"]


def test_the_parameters_of_a_part_are_derived_from_the_base_class():
    registry = Registry("wheel", WheelParameters)
    registry.register("plain")(int)
    assert registry.parameters_of("plain") is WheelParameters
    message = "parameters of the wheel 'odd' must be derived from WheelParameters"
    with pytest.raises(TypeError, match=message):
        registry.register("odd", NoParameters)
    assert "odd" not in registry


def test_a_part_is_made_of_its_parameters_if_it_has_any():
    registry = Registry("wheel")
    registry.register("wooden", WheelParameters)(lambda parameters: parameters.radius)
    registry.register("air")(lambda: "pumped")
    assert registry.make("wooden", WheelParameters(2.0)) == 2.0
    assert registry.make("air", NoParameters()) == "pumped"


def test_an_unknown_name_raises_a_key_error(wheels):
    registry, _, _ = wheels
    for look_up in (registry.__getitem__, registry.parameters_of):
        with pytest.raises(KeyError):
            look_up("steel")


def test_registries_are_independent(wheels):
    other = Registry("wheel")
    assert list(other) == []
    other.register("wooden")(int)
    assert wheels[0]["wooden"] is not int


def test_choices_of_a_parameter_grow_with_the_registry(wheels):
    registry, _, pumped = wheels

    @dataclass(frozen=True)
    class Cart:
        wheel: str = declared("wooden", "Wheel.", choices=registry)

    assert declarations(Cart)["wheel"].choices == ("wooden", "air")
    registry.register("steel")(pumped)
    assert declarations(Cart)["wheel"].choices == ("wooden", "air", "steel")


def test_the_shipped_parts():
    assert set(CUES) == {
        "color_contrast",
        "color_histogram",
        "coarse_correlation_response",
        "correlation_response",
        "foreground",
        "foreground_color_histogram",
        "gradient_orientation",
        "hog",
    }
    assert set(MOTION_MODELS) == {
        "affine",
        "constant_velocity",
        "constant_velocity_and_size",
        "second_order_autoregressive",
    }
    assert set(RESAMPLERS) == {
        *("multinomial", "multinomial_elitist", "stratified", "systematic", "residual")
    }
    assert set(FEATURES) == {"gradients_and_colors"}


def printed(code):
    """JSON output of a fresh interpreter, where only the code registers parts."""
    outcome = subprocess.run(
        [sys.executable, "-c", code],
        capture_output=True,
        text=True,
        timeout=TIMEOUT,
        check=False,
    )
    assert outcome.returncode == 0, outcome.stderr
    return json.loads(outcome.stdout)


@pytest.mark.parametrize(
    "first",
    [
        "pf_tracker_ros.cues.hog",
        "pf_tracker_ros.filter.resampling",
        "pf_tracker_ros.tracking.parameters",
    ],
)
def test_the_order_is_the_same_whatever_is_imported_first(first):
    code = f"""
import json
import {first}
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
print(json.dumps([list(CUES), list(MOTION_MODELS), list(RESAMPLERS)]))
"""
    assert printed(code) == [list(CUES), list(MOTION_MODELS), list(RESAMPLERS)]


@pytest.fixture
def package(tmp_path, monkeypatch):
    """The folder of a new package `garage`."""
    folder = tmp_path / "garage"
    folder.mkdir()
    monkeypatch.syspath_prepend(tmp_path)
    yield folder
    for name in [name for name in sys.modules if name.partition(".")[0] == "garage"]:
        del sys.modules[name]


def test_every_file_of_a_package_is_imported_in_the_order_of_their_names(package):
    (package / "__init__.py").write_text(
        "from pf_tracker_ros.registry import Registry, import_all\n"
        "CARS = Registry('car')\n"
        "import_all(__name__, __path__)\n"
    )
    for name in ("zebra", "ant", "middle"):
        (package / f"{name}.py").write_text(
            f"from garage import CARS\nCARS.register('{name}')(dict)\n"
        )
    (package / "notes.txt").write_text("no module\n")
    assert list(importlib.import_module("garage").CARS) == ["ant", "middle", "zebra"]


def test_a_file_that_cannot_be_imported_raises(package):
    (package / "__init__.py").write_text(
        "from pf_tracker_ros.registry import import_all\nimport_all(__name__, __path__)\n"
    )
    (package / "broken.py").write_text("import no_such_module_anywhere\n")
    with pytest.raises(ModuleNotFoundError, match="no_such_module_anywhere"):
        importlib.import_module("garage")
