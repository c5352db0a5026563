"""Packaging of pf_tracker_ros for pip and for colcon (ament_python).

The version is here and in package.xml; `catkin_prepare_release` raises both.
"""

from pathlib import Path

from setuptools import find_packages, setup

PACKAGE = "pf_tracker_ros"
SHARE = f"share/{PACKAGE}"
ROOT = Path(__file__).resolve().parent


def shared_files(folder: str, *patterns: str) -> list[str]:
    """Paths of the files of a folder, relative to this file, for `data_files`."""
    found = [path for pattern in patterns for path in (ROOT / folder).glob(pattern)]
    return sorted(str(path.relative_to(ROOT)) for path in found)


# OpenCV is an extra. PyPI has several packages with the module cv2, and pip would install this one
# over another.
OPENCV = ["opencv-python-headless>=4.6,<5"]
# Reads rosbag2 folders and MCAP files without rosbag2_py; safe beside ROS from apt.
BAGS = [
    "rosbags>=0.11.9,<0.12",
    # A dependency of rosbags; this version leaves the file of a bag open on Python 3.10.
    "apsw!=3.54.0.0; python_version < '3.11'",
]

# Decodes videos with the times of the container; OpenCV does too, but reports no damage.
VIDEOS = ["av>=17,<19"]

# Assignment of detections to tracks, for several targets.
TARGETS = ["scipy>=1.8"]

ARCHIVES = ["fsspec>=2023.6"]

EXTRAS = {
    # ROS 2 Jazzy from PyPI (third-party wheels, Linux x86-64, Python 3.10 to 3.13), for an
    # environment of its own. Never beside ROS from apt.
    "ros": [
        "ros-jazzy-rclpy[fastrtps]==7.1.6",
        "ros-jazzy-common-interfaces==5.3.6",
        # Its generators, which tools/make_vision_msgs.py runs, need it.
        "catkin-pkg>=1.0",
        "pyyaml",
        *OPENCV,
        *BAGS,
        *VIDEOS,
        *TARGETS,
    ],
    "opencv": OPENCV,
    "bags": BAGS,
    "videos": VIDEOS,
    "targets": TARGETS,
    # The console; Ubuntu 24.04 has this version.
    "console": ["aiohttp>=3.9,<4"],
    "evaluation": ["rich>=13", "matplotlib>=3.6", "jinja2>=3", *VIDEOS],
    # The command `track`. With ROS from apt, rosdep has all of these except rosbags (writes bags)
    # and av.
    "recordings": ["rich>=13", "matplotlib>=3.6", "jinja2>=3", "pyyaml", *BAGS, *VIDEOS],
    # Identity by a network; ONNX Runtime is several times as fast as OpenCV.
    "networks": ["onnxruntime>=1.17", "pyyaml"],
    "parquet": ["pyarrow>=14"],
    # Archives at URLs; for s3://, gs:// and so on, fsspec names the package that it needs.
    "archives": ARCHIVES,
    # Archives on a Ray cluster; each machine needs it.
    "ray": ["ray>=2.40,<3", *ARCHIVES],
    # The command `tune`.
    "tune": ["optuna>=5,<6", "rich>=13", "matplotlib>=3.6", "jinja2>=3", "pyyaml", *TARGETS],
    # colcon finds pytest in the extra of this name, and runs the tests with it.
    "test": [
        "pytest>=7.4,<9",
        "hypothesis>=6.98",
        "catkin-pkg>=1.0",
        "pillow>=9",
        "pyyaml",
        # Controls an installed Chromium; the package contains no browser.
        "playwright>=1.49",
    ],
    # `make docs`: the site; see CONTRIBUTING.md for why Sphinx.
    "docs": ["sphinx>=8.1", "myst-parser>=4", "furo>=2024.8"],
    "development": [
        "pytest-xdist>=3.5",
        "colcon-common-extensions==0.3.0",
        "setuptools>=70.1,<80",
        "uv",
        "ruff",
        "mypy",
        "codespell",
    ],
}

setup(
    name=PACKAGE,
    version="1.0.0",
    description="Visual object tracking in ROS 2 with a particle filter that fuses several cues",
    long_description=(ROOT / "README.md").read_text(encoding="utf-8"),
    long_description_content_type="text/markdown",
    author="pf_tracker_ros maintainers",
    author_email="pf-tracker-ros@example.org",
    maintainer="pf_tracker_ros maintainers",
    maintainer_email="pf-tracker-ros@example.org",
    license="Apache-2.0",
    url="https://github.com/pf-tracker-ros/pf_tracker_ros",
    project_urls={"Issues": "https://github.com/pf-tracker-ros/pf_tracker_ros/issues"},
    python_requires=">=3.10",
    packages=find_packages(include=[PACKAGE, f"{PACKAGE}.*"]),
    package_data={
        PACKAGE: [
            "py.typed",
            "evaluation/reports/*.jinja",
            "node/console/page/*",
            "pages/shared/*",
            "recordings/drawing/page/*",
        ],
    },
    data_files=[
        ("share/ament_index/resource_index/packages", [f"resource/{PACKAGE}"]),
        (SHARE, ["package.xml"]),
        (f"{SHARE}/config", shared_files("config", "*.yaml", "*.xml", "*.json", "*.rviz")),
        (f"{SHARE}/launch", shared_files("launch", "*.launch.py")),
    ],
    install_requires=["numpy>=1.24"],
    extras_require=EXTRAS,
    zip_safe=False,
    entry_points={
        "console_scripts": [
            f"tracker = {PACKAGE}.commands:tracker",
            f"localizer = {PACKAGE}.commands:localizer",
            f"replay = {PACKAGE}.commands:replay",
            f"console = {PACKAGE}.commands:console",
            f"watch = {PACKAGE}.commands:watch",
            f"evaluate = {PACKAGE}.commands:evaluate",
            f"track = {PACKAGE}.commands:track",
            f"tune = {PACKAGE}.commands:tune",
            f"model = {PACKAGE}.commands:model",
        ],
    },
)
