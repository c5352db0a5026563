"""package.xml, setup.py and the changelog agree with each other and with the code."""

import ast
import re
import sys
from pathlib import Path

import pytest

catkin_package = pytest.importorskip("catkin_pkg.package")

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "pf_tracker_ros"
# The rosdep keys of what is not a ROS package.
ROSDEP_KEYS = {
    "catkin_pkg": "python3-catkin-pkg-modules",
    "cv2": "python3-opencv",
    "hypothesis": "python3-hypothesis",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "rosbags": "python3-rosbags-pip",
    "yaml": "python3-yaml",
}


@pytest.fixture(scope="module")
def manifest():
    warnings = []
    package = catkin_package.parse_package(str(REPOSITORY / "package.xml"), warnings=warnings)
    package.validate(warnings=warnings)
    assert warnings == []
    return package


def setup_arguments():
    """The literal arguments of the call of setup()."""
    tree = ast.parse((REPOSITORY / "setup.py").read_text())
    calls = [node for node in ast.walk(tree) if isinstance(node, ast.Call)]
    (call,) = [call for call in calls if getattr(call.func, "id", "") == "setup"]
    return {
        keyword.arg: keyword.value.value
        for keyword in call.keywords
        if isinstance(keyword.value, ast.Constant)
    }


def imported(*folders):
    """Top-level names of other packages that the Python files of some folders import."""
    names = set()
    for folder in folders:
        for path in (REPOSITORY / folder).rglob("*.py"):
            for node in ast.walk(ast.parse(path.read_text())):
                if isinstance(node, ast.Import):
                    names.update(alias.name.partition(".")[0] for alias in node.names)
                elif isinstance(node, ast.ImportFrom) and node.level == 0:
                    names.add(node.module.partition(".")[0])
    return names - set(sys.stdlib_module_names) - {PACKAGE}


def keys(names):
    return {ROSDEP_KEYS.get(name, name) for name in names}


def test_manifest_is_valid_and_built_by_ament_python(manifest):
    assert manifest.name == PACKAGE
    assert manifest.package_format == 3
    assert manifest.get_build_type() == "ament_python"
    (license_,) = manifest.licenses
    assert license_ == "Apache-2.0"
    assert (REPOSITORY / license_.file).read_text().lstrip().startswith("Apache License")


def test_version_is_the_same_everywhere(manifest):
    assert setup_arguments()["version"] == manifest.version
    # Released sections carry a date; what is not released yet stands above them.
    changelog = (REPOSITORY / "CHANGELOG.rst").read_text()
    titles = re.findall(r"^(Forthcoming|\d\S+ \(\d{4}-\d\d-\d\d\))\n-+$", changelog, re.MULTILINE)
    released = [title.split()[0] for title in titles if title != "Forthcoming"]
    assert titles
    assert released[:1] in ([], [manifest.version])


def test_maintainer_and_license_are_the_same_in_setup_and_manifest(manifest):
    arguments = setup_arguments()
    (maintainer,) = manifest.maintainers
    assert (arguments["maintainer"], arguments["maintainer_email"]) == (
        maintainer.name,
        maintainer.email,
    )
    assert [arguments["license"]] == manifest.licenses


def test_what_the_package_and_the_launch_files_import_is_declared_and_nothing_else(manifest):
    declared = {dependency.name for dependency in manifest.exec_depends}
    assert declared == keys(imported(PACKAGE, "launch"))


def test_what_the_tests_import_is_declared(manifest):
    declared = {dependency.name for dependency in manifest.exec_depends + manifest.test_depends}
    # Packaging comes with pytest; the demo's and the benchmarks' modules are of this repository.
    own = {
        path.stem
        for folder in ("demo", "benchmarks")
        for path in (REPOSITORY / folder).glob("*.py")
    }
    assert keys(imported("test")) - {"packaging"} - own <= declared


def test_every_folder_with_modules_is_a_package():
    folders = {path.parent for path in (REPOSITORY / PACKAGE).rglob("*.py")}
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []


def test_pinned_requirements_keep_the_pins_of_setup():
    pins = dict(re.findall(r"^(\S+)==(\S+)$", requirements_text(), re.MULTILINE))
    exact = re.findall(r'"([\w.-]+)(?:\[\w+\])?==([\w.]+)"', (REPOSITORY / "setup.py").read_text())
    assert exact
    for name, version in exact:
        assert pins[name] == version
    # launch_testing breaks with pytest 9, colcon with setuptools 80.
    assert int(pins["pytest"].partition(".")[0]) < 9
    assert int(pins["setuptools"].partition(".")[0]) < 80


def requirements_text():
    return (REPOSITORY / "requirements" / "development.txt").read_text()
