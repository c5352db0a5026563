"""package.xml, setup.py and the changelog agree with each other and with the code."""

import ast
import contextlib
import re
import shutil
import sys
from pathlib import Path

import pytest
import yaml
from packaging.requirements import Requirement

catkin_package = pytest.importorskip("catkin_pkg.package")

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "pf_tracker_ros"
OPTIONAL = {"av", "fsspec", "onnxruntime", "optuna", "playwright", "pyarrow", "pytest"}
OPTIONAL |= {"ray", "rosbags"}
# What no import statement names: what reads bags where ROS is, found once a bag is opened, and the
# messages that only `node.messages.new_message` makes, by the names of their types.
FOUND_AT_RUN_TIME = {
    "rosbag2_compression_zstd",
    "rosbag2_py",
    "rosbag2_storage_default_plugins",
    "rosbag2_storage_mcap",
    "tf2_ros_py",
    "vision_msgs",
}
# A faster engine of networks, which OpenCV runs as well.
NOT_PINNED = {"onnxruntime"}
# The rosdep keys of what is not a ROS package.
ROSDEP_KEYS = {
    "PIL": "python3-pil",
    "aiohttp": "python3-aiohttp",
    "catkin_pkg": "python3-catkin-pkg-modules",
    "cv2": "python3-opencv",
    "hypothesis": "python3-hypothesis",
    "jinja2": "python3-jinja2",
    # It has no key of its own; Jinja2 depends on it.
    "markupsafe": "python3-jinja2",
    "matplotlib": "python3-matplotlib",
    "numpy": "python3-numpy",
    "pytest": "python3-pytest",
    "rich": "python3-rich",
    "scipy": "python3-scipy",
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
    arguments = {}
    for keyword in call.keywords:
        with contextlib.suppress(ValueError):
            arguments[keyword.arg] = ast.literal_eval(keyword.value)
    return arguments


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
    folders = {path.parent for path in (REPOSITORY / PACKAGE).rglob("*.py")}
    assert [folder for folder in folders if not (folder / "__init__.py").is_file()] == []
    # docs.ros.org builds the project's own documentation.
    (export,) = [one for one in manifest.exports if one.tagname == "rosdoc2"]
    header, settings = yaml.safe_load_all((REPOSITORY / export.content).read_text())
    assert header == {"type": "rosdoc2 config", "version": 1}
    folder = REPOSITORY / settings["builders"][0]["sphinx"]["sphinx_sourcedir"]
    # Of a page index.md, rosdoc2 makes no start page.
    assert (folder / "conf.py").is_file()
    assert (folder / "index.rst").is_file()


def test_version_maintainer_license_and_addresses_are_the_same_everywhere(manifest):
    arguments = setup_arguments()
    assert arguments["version"] == manifest.version
    (maintainer,) = manifest.maintainers
    assert arguments["maintainer"] == maintainer.name
    assert arguments["maintainer_email"] == maintainer.email
    assert [arguments["license"]] == manifest.licenses
    addresses = {url.type: url.url for url in manifest.urls}
    assert set(addresses) == {"website", "repository", "bugtracker"}
    assert addresses["website"] == addresses["repository"] == arguments["url"]
    assert addresses["bugtracker"] == arguments["project_urls"]["Issues"]
    # Released sections carry a date; what is not released yet stands above them.
    changelog = (REPOSITORY / "CHANGELOG.rst").read_text()
    titles = re.findall(r"^(Forthcoming|\d\S+ \(\d{4}-\d\d-\d\d\))\n-+$", changelog, re.MULTILINE)
    released = [title.split()[0] for title in titles if title != "Forthcoming"]
    assert titles
    assert released[:1] in ([], [manifest.version])
    citation = yaml.safe_load((REPOSITORY / "CITATION.cff").read_text())
    assert citation["version"] == manifest.version
    assert citation["license"] == manifest.licenses[0]
    assert citation["repository-code"] == manifest.urls[0].url
    assert f"\n{manifest.version} ({citation['date-released']})\n---" in changelog


def test_the_workflow_runs_the_checks_on_every_supported_python_and_colcon_in_jazzy():
    path = REPOSITORY / ".github" / "workflows" / "ci.yaml"
    jobs = yaml.safe_load(path.read_text())["jobs"]
    checks, jazzy = jobs["checks"], jobs["jazzy"]
    assert checks["strategy"]["matrix"]["python"] == ["3.10", "3.11", "3.12", "3.13"]
    assert ".ci/run" in [step.get("run") for step in checks["steps"]]
    assert "jazzy" in jazzy["container"]
    commands = "".join(step.get("run", "") for step in jazzy["steps"])
    for command in ("rosdep install", "colcon build", "colcon test ", "colcon test-result"):
        assert command in commands


def test_what_is_imported_is_declared_and_nothing_else_and_the_build_farm_has_it(manifest):
    """A binary release may depend on packages of the distribution, not on those of pip."""
    declared = {dependency.name for dependency in manifest.exec_depends}
    assert declared == keys(imported(PACKAGE, "launch") - OPTIONAL) | FOUND_AT_RUN_TIME
    declared |= {dependency.name for dependency in manifest.test_depends}
    # Packaging comes with pytest; the modules of these folders are of this repository.
    own = {
        path.stem
        for folder in ("demo", "benchmarks", "tools", "test/helpers")
        for path in (REPOSITORY / folder).iterdir()
    }
    assert keys(imported("test") - OPTIONAL) - {"packaging"} - own <= declared
    assert [key for key in declared if key.endswith("-pip")] == []


def test_a_release_takes_the_changelog_and_raises_every_version(manifest, tmp_path):
    """What `catkin_prepare_release` and bloom do with the files."""
    tools = pytest.importorskip("catkin_pkg.package_version")
    changelogs = pytest.importorskip("catkin_pkg.changelog")
    text = (REPOSITORY / "CHANGELOG.rst").read_text()
    label = tools.get_forthcoming_label(text)
    released = manifest.version
    if label is not None:
        released = "9.8.7"
        text = tools.rename_section(text, label, f"{released} (2001-02-03)")
    changelog = changelogs.Changelog(PACKAGE)
    changelogs.populate_changelog_from_rst(changelog, text)
    contents = {version: content for version, _, content in changelog.foreach_version()}
    assert {released, manifest.version} == contents.keys()
    assert contents[released][0].bullets

    for name in ("package.xml", "setup.py"):
        shutil.copy2(REPOSITORY / name, tmp_path)
    tools.update_versions({str(tmp_path): manifest}, "9.8.7")
    assert "<version>9.8.7</version>" in (tmp_path / "package.xml").read_text()
    assert 'version="9.8.7"' in (tmp_path / "setup.py").read_text()


def pinned(python):
    """Name to version of what is pinned for a version of Python on Linux, each name only once."""
    environment = {
        "implementation_name": "cpython",
        "platform_python_implementation": "CPython",
        "python_full_version": f"{python}.1",
        "python_version": python,
        "sys_platform": "linux",
    }
    text = (REPOSITORY / "requirements" / "development.txt").read_text()
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    requirements = [Requirement(line) for line in lines]
    chosen = [one for one in requirements if not one.marker or one.marker.evaluate(environment)]
    pins = {one.name: re.fullmatch("==([^*]+)", str(one.specifier))[1] for one in chosen}
    assert len(pins) == len(chosen)
    return pins


@pytest.mark.parametrize("python", ["3.10", "3.11", "3.12", "3.13"])
def test_pinned_requirements_keep_the_pins_of_setup(python):
    pins = pinned(python)
    text = (REPOSITORY / "setup.py").read_text()
    wanted = [Requirement(one) for one in re.findall(r'"([\w.-]+(?:\[\w+\])?[=<>][^"]*)"', text)]
    wanted = [one for one in wanted if one.name not in NOT_PINNED]
    assert {"numpy", "opencv-python-headless", "ros-jazzy-rclpy"} < {one.name for one in wanted}
    for requirement in wanted:
        assert requirement.specifier.contains(pins[requirement.name]), requirement
    # launch_testing breaks with pytest 9, colcon with setuptools 80.
    assert int(pins["pytest"].partition(".")[0]) < 9
    assert int(pins["setuptools"].partition(".")[0]) < 80


def test_pinned_requirements_name_no_place_and_one_opencv():
    """What `make lock` wrote depends on no machine; the benchmark measures what is tested."""
    folder, versions = REPOSITORY / "requirements", {}
    text = (folder / "development.txt").read_text()
    assert "make lock" in text
    assert not re.search(r"^-|[@/\\]", text, re.MULTILINE)
    for name in ("bench", "development"):
        lines = (folder / f"{name}.txt").read_text()
        versions |= re.findall(r"^(opencv\S*)==([^\s;]+)", lines, re.MULTILINE)
    assert versions.keys() == {"opencv-contrib-python-headless", "opencv-python-headless"}
    assert len(set(versions.values())) == 1
