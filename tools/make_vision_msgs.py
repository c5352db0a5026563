"""Make the messages of detectors, vision_msgs, for the environment with ROS 2 from PyPI.

PyPI lacks them, but its wheels have the generators of ROS. So that nodes of other machines, with
vision_msgs from apt, understand each other, fields and type hashes are the same.

1. Write the definitions of the messages of a detector.
2. Let the generators of ROS make C, C++ and Python of them.
3. Compile it into libraries and a Python extension, and install the package.
"""

from __future__ import annotations

import argparse
import contextlib
import io
import logging
import os
import shutil
import subprocess
import sys
import sysconfig
import tempfile
from collections.abc import Sequence
from concurrent.futures import ThreadPoolExecutor
from importlib.util import find_spec
from pathlib import Path

PACKAGE = "vision_msgs"
# The libraries that ROS makes of a package: the structures in C, two type supports (Fast DDS writes
# messages with one, and describes their types with the other), what chooses between them, Python.
STRUCTURES = "rosidl_generator_c"
FASTRTPS = "rosidl_typesupport_fastrtps_c"
INTROSPECTION = "rosidl_typesupport_introspection_c"
DISPATCH = "rosidl_typesupport_c"
PYTHON = "rosidl_generator_py"
_RESULTS = "std_msgs/Header header\nObjectHypothesisWithPose[] results\n"
# Name to fields, as in vision_msgs 4. Later ones use earlier ones.
DEFINITIONS = {
    "Point2D": "float64 x\nfloat64 y\n",
    "Pose2D": "vision_msgs/Point2D position\nfloat64 theta\n",
    "BoundingBox2D": "vision_msgs/Pose2D center\nfloat64 size_x\nfloat64 size_y\n",
    "BoundingBox3D": "geometry_msgs/Pose center\ngeometry_msgs/Vector3 size\n",
    "ObjectHypothesis": "string class_id\nfloat64 score\n",
    "ObjectHypothesisWithPose": (
        "ObjectHypothesis hypothesis\ngeometry_msgs/PoseWithCovariance pose\n"
    ),
    "Detection2D": f"{_RESULTS}BoundingBox2D bbox\nstring id\n",
    "Detection2DArray": "std_msgs/Header header\nDetection2D[] detections\n",
    "Detection3D": f"{_RESULTS}BoundingBox3D bbox\nstring id\n",
    "Detection3DArray": "std_msgs/Header header\nDetection3D[] detections\n",
}
_USED_PACKAGES = ("builtin_interfaces", "geometry_msgs", "std_msgs")
# With the parts of the libraries that the generated code calls.
_LIBRARIES = (
    *(
        f"{package}__{part}"
        for package in _USED_PACKAGES
        for part in (STRUCTURES, FASTRTPS, INTROSPECTION, PYTHON)
    ),
    *(FASTRTPS, INTROSPECTION, "rosidl_typesupport_fastrtps_cpp", DISPATCH),
    *("rosidl_runtime_c", "rmw", "rcutils", "fastcdr"),
)


class BuildError(Exception):
    """The messages cannot be made; the text says why."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Make and install the messages.

    Args:
        arguments: Command line without the program name; None for that of the process.

    Returns:
        The exit code, 1 if it failed.
    """
    parser = argparse.ArgumentParser(description=str(__doc__).partition("\n")[0])
    parser.add_argument(
        "--target", type=Path, help="folder for the Python package (default: this environment's)"
    )
    target = parser.parse_args(arguments).target or Path(sysconfig.get_path("platlib"))
    try:
        check(target)
        with tempfile.TemporaryDirectory() as folder:
            generate(Path(folder))
            compile_libraries(Path(folder))
            install(Path(folder), target)
    except BuildError as error:
        print(f"error: {error}", file=sys.stderr)
        return 1
    print(f"{PACKAGE} is installed in {target}")
    return 0


def check(target: Path) -> None:
    """Check what is needed, and that nothing is replaced.

    Raises:
        BuildError: Something is missing, or there.
    """
    if find_spec(PACKAGE) or (target / PACKAGE).exists():
        raise BuildError(f"{PACKAGE} is installed already")
    if find_spec("rosidl_generator_py") is None or not (_prefix() / "include" / "rmw").exists():
        raise BuildError(
            "this environment has no ROS from PyPI; with ROS from apt, run "
            "`apt install ros-jazzy-vision-msgs`"
        )
    if find_spec("catkin_pkg") is None:
        raise BuildError(
            "the generators of ROS need catkin_pkg; run "
            f"`{sys.executable} -m pip install catkin-pkg`"
        )
    if shutil.which("g++") is None:
        raise BuildError("there is no C++ compiler; run `apt install g++`")
    if not (Path(sysconfig.get_path("include")) / "Python.h").exists():
        raise BuildError("the headers of Python are missing; run `apt install python3-dev`")


def generate(folder: Path) -> None:
    """Generate the sources, each generator into a folder of its own."""
    # The wheels name no place of their interfaces.
    os.environ.setdefault("AMENT_PREFIX_PATH", str(_prefix()))
    # The wheels list their generators twice, which these report each time.
    logging.disable(logging.WARNING)
    from rosidl_generator_c.cli import GenerateC
    from rosidl_generator_py.cli import GeneratePython
    from rosidl_typesupport_c.cli import GenerateCTypesupport
    from rosidl_typesupport_fastrtps_c.cli import GenerateFastRTPSCTypesupport
    from rosidl_typesupport_introspection_c.cli import GenerateIntrospectionCTypesupport

    definitions = folder / "definitions"
    (definitions / "msg").mkdir(parents=True)
    for name, text in DEFINITIONS.items():
        (definitions / "msg" / f"{name}.msg").write_text(text)
    generators = {
        STRUCTURES: GenerateC("c"),
        FASTRTPS: GenerateFastRTPSCTypesupport("c"),
        INTROSPECTION: GenerateIntrospectionCTypesupport("c"),
        DISPATCH: GenerateCTypesupport("c", typesupport_implementations=[FASTRTPS, INTROSPECTION]),
        PYTHON: GeneratePython("py", typesupport_implementations=[DISPATCH]),
    }
    for name, generator in generators.items():
        # The generated code includes headers as of its package's name.
        (folder / name / PACKAGE).mkdir(parents=True)
        with contextlib.redirect_stdout(io.StringIO()):
            generator.generate(
                package_name=PACKAGE,
                interface_files=[f"{definitions}:msg/{name}.msg" for name in DEFINITIONS],
                include_paths=[str(_prefix() / "share")],
                output_path=folder / name / PACKAGE,
            )


def compile_libraries(folder: Path) -> None:
    """Compile the sources into libraries beside the Python package.

    Raises:
        BuildError: The compiler failed.
    """
    import numpy as np

    parts = (STRUCTURES, FASTRTPS, INTROSPECTION, DISPATCH, PYTHON)
    includes = [*(folder / part for part in parts), _prefix() / "include"]
    includes += [*sorted((_prefix() / "include").iterdir())]
    includes += [Path(sysconfig.get_path("include")), Path(np.get_include())]
    options = ["-O1", "-fPIC", "-w", f"-DROS_PACKAGE_NAME={PACKAGE}"]
    options += [f"-I{include}" for include in includes]

    def compile_one(file: Path) -> str:
        compiler = ["gcc", "-std=gnu11"] if file.suffix == ".c" else ["g++", "-std=c++17"]
        _run([*compiler, *options, "-c", str(file), "-o", f"{file}.o"])
        return f"{file}.o"

    libraries = _prefix() / "lib"
    found = [_library(libraries, name) for name in _LIBRARIES]
    built: list[str] = []
    with ThreadPoolExecutor(os.cpu_count()) as threads:
        for part in parts:
            sources = [*(folder / part).rglob("*.c"), *(folder / part).rglob("*.cpp")]
            objects = list(threads.map(compile_one, sorted(sources)))
            # The type supports are found by the names of their libraries, as they are loaded then.
            name = f"{PACKAGE}_s__{DISPATCH}.so" if part == PYTHON else f"lib{PACKAGE}__{part}.so"
            path = str(folder / PYTHON / PACKAGE / name)
            linked = ["-Wl,--no-as-needed", *built, *found, f"-Wl,-soname,{name}"]
            linked += [f"-Wl,-rpath,{libraries}", "-Wl,-rpath,$ORIGIN"]
            _run(["g++", "-shared", "-o", path, *objects, *linked])
            built.append(path)


def install(folder: Path, target: Path) -> None:
    """Copy the Python package to its place."""
    kept = shutil.ignore_patterns("tmp", "*.c", "*.o")
    (folder / PYTHON / PACKAGE / "__init__.py").touch()
    shutil.copytree(folder / PYTHON / PACKAGE, target / PACKAGE, ignore=kept)


def _library(folder: Path, name: str) -> str:
    for path in sorted(folder.glob(f"lib{name}.so*")):
        return str(path)
    raise BuildError(f"the ROS wheels have no lib{name}.so")


def _run(command: Sequence[str]) -> None:
    done = subprocess.run(command, capture_output=True, text=True, check=False)
    if done.returncode:
        raise BuildError(f"{command[0]} failed:\n{done.stderr.strip()}")


def _prefix() -> Path:
    return Path(sys.prefix)


if __name__ == "__main__":
    sys.exit(main())
