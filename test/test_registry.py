"""Registries: parts selected by name, each registered in its own module."""

import importlib
import json
import sys
from dataclasses import dataclass

import pytest
from common import run_python

from pf_tracker_ros.cues import CUES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
from pf_tracker_ros.parameters import declarations, declared
from pf_tracker_ros.registry import NoParameters, Registry


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
    assert registry.parameters_of("wooden") is WheelParameters
    assert registry.parameters_of("air") is NoParameters
    # Names are in the order in which they registered.
    registry.register("a")(pumped)
    assert list(registry.items()) == [("wooden", wooden), ("air", pumped), ("a", pumped)]
    assert len(registry) == 3
    assert list(Registry("wheel")) == []
    for look_up in (registry.__getitem__, registry.parameters_of):
        with pytest.raises(KeyError):
            look_up("steel")


def test_a_name_that_is_taken_is_refused_and_keeps_its_part(wheels):
    registry, wooden, pumped = wheels
    with pytest.raises(ValueError, match="there is a wheel 'wooden' already; choose another name"):
        registry.register("wooden")(pumped)
    assert registry["wooden"] is wooden
    assert registry.parameters_of("wooden") is WheelParameters
    assert list(registry) == ["wooden", "air"]


def test_a_part_is_made_of_its_parameters_if_it_has_any():
    registry = Registry("wheel")
    registry.register("wooden", WheelParameters)(lambda parameters: parameters.radius)
    registry.register("air")(lambda: "pumped")
    assert registry.make("wooden", WheelParameters(2.0)) == 2.0
    assert registry.make("air", NoParameters()) == "pumped"
    derived = Registry("wheel", WheelParameters)
    derived.register("plain")(int)
    assert derived.parameters_of("plain") is WheelParameters
    message = "parameters of the wheel 'odd' must be derived from WheelParameters"
    with pytest.raises(TypeError, match=message):
        derived.register("odd", NoParameters)
    assert "odd" not in derived


def test_choices_of_a_parameter_grow_with_the_registry(wheels):
    registry, _, pumped = wheels

    @dataclass(frozen=True)
    class Cart:
        wheel: str = declared("wooden", "Wheel.", choices=registry)

    assert declarations(Cart)["wheel"].choices == ("wooden", "air")
    registry.register("steel")(pumped)
    assert declarations(Cart)["wheel"].choices == ("wooden", "air", "steel")


@pytest.mark.parametrize("first", ["cues.hog", "filter.resampling", "tracking.parameters"])
def test_the_order_is_the_same_whatever_is_imported_first(first):
    """In a fresh interpreter, where only the code registers parts."""
    code = f"""
import json
import pf_tracker_ros.{first}
from pf_tracker_ros.cues import CUES
from pf_tracker_ros.filter import MOTION_MODELS, RESAMPLERS
print(json.dumps([list(CUES), list(MOTION_MODELS), list(RESAMPLERS)]))
"""
    printed = run_python(code).stdout
    assert json.loads(printed) == [list(CUES), list(MOTION_MODELS), list(RESAMPLERS)]


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
    (package / "broken.py").write_text("import no_such_module_anywhere\n")
    with pytest.raises(ModuleNotFoundError, match="no_such_module_anywhere"):
        importlib.reload(sys.modules["garage"])
