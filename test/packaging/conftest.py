"""Installations of the package, made without downloads out of what this environment has installed.

Packages that an installation needs are hard-linked into it by their lists of files, so that pip
finds exactly those which it may find, and each virtual environment is a real one.
"""

import contextlib
import json
import os
import shutil
import signal
import subprocess
import sys
import sysconfig
import tempfile
import venv
from collections import namedtuple
from dataclasses import dataclass
from importlib import metadata
from pathlib import Path

import pytest
from packaging.requirements import Requirement

REPOSITORY = Path(__file__).resolve().parents[2]
PACKAGE = "pf_tracker_ros"
NOT_IN_A_CLONE = shutil.ignore_patterns(
    *(".git", ".venv*", "build", "install", "log", "dist", "*.egg-info"),
    *("__pycache__", ".*_cache", ".hypothesis", "results"),
)
# What a shell that has sourced nothing does not have.
LEFT_BY_OTHERS = ("AMENT_", "COLCON_", "PYTHON", "PIP_", "ROS_DISTRO", "VIRTUAL_ENV")


@dataclass(frozen=True)
class Installation:
    """Where the package is installed, and the environment in which a user would call it.

    Attributes:
        prefix: Folder with the package's `share/`.
        executables: Folder of its executables.
        python: Interpreter that they run with.
        variables: Environment variables.
    """

    prefix: Path
    executables: Path
    python: Path
    variables: dict

    @property
    def share(self):
        return self.prefix / "share" / PACKAGE

    def call(self, executable, *arguments):
        """Run an executable to its end."""
        return self._run(self.executables / executable, *arguments)

    def evaluate(self, code):
        """What a Python program prints."""
        outcome = self._run(self.python, "-c", code)
        assert outcome.returncode == 0, outcome.stderr
        return outcome.stdout.strip()

    @contextlib.contextmanager
    def started(self, executable, *arguments):
        """An executable while it runs; it is ended with the block."""
        command = [str(part) for part in (self.executables / executable, *arguments)]
        with tempfile.TemporaryFile("w+") as log:
            process = subprocess.Popen(
                command,
                env=self._now(),
                cwd=self.prefix,
                stdin=subprocess.DEVNULL,
                stdout=log,
                stderr=subprocess.STDOUT,
            )
            try:
                yield process
            finally:
                process.kill()
                process.wait()
                # pytest shows it if the test fails.
                log.seek(0)
                print(log.read())

    def _run(self, *command):
        # Not in the repository, whose files Python would find first.
        return run(*command, variables=self._now(), folder=self.prefix)

    def _now(self):
        """The variables, with the ROS domain and the like of the test that is running."""
        given = {name: value for name, value in os.environ.items() if name.startswith("ROS_")}
        return {**self.variables, **{k: v for k, v in given.items() if k != "ROS_DISTRO"}}


def run(*command, variables, folder):
    """Run a command to its end and take what it prints."""
    return subprocess.run(
        [str(part) for part in command],
        env=variables,
        cwd=folder,
        stdin=subprocess.DEVNULL,
        capture_output=True,
        text=True,
        timeout=120,
        check=False,
    )


def plain_variables():
    """The environment of a shell that has sourced nothing."""
    variables = {k: v for k, v in os.environ.items() if not k.startswith(LEFT_BY_OTHERS)}
    # The ROS wheels' own marks, with which a child would take this process' libraries.
    for name in ("_ROS_WHEELS_BOOTSTRAP_COMPLETE", "LD_LIBRARY_PATH"):
        variables.pop(name, None)
    return variables


def closure(texts):
    """The installed distributions that a list of requirements needs, by name."""
    found, seen = {}, set()
    pending = [Requirement(text) for text in texts]
    while pending:
        requirement = pending.pop()
        extras = sorted(requirement.extras)
        if (requirement.name, *extras) in seen:
            continue
        seen.add((requirement.name, *extras))
        found[requirement.name] = distribution = metadata.distribution(requirement.name)
        for text in distribution.requires or []:
            child = Requirement(text)
            if applies(child, extras):
                pending.append(child)
    return found


def applies(requirement, extras=()):
    """Whether a requirement holds here, given the extras that were asked for."""
    marker = requirement.marker
    return marker is None or any(marker.evaluate({"extra": extra}) for extra in ("", *extras))


def link(distributions, prefix, leave_out=lambda path: False):
    """Hard-link the files of installed distributions below another prefix."""
    for distribution in distributions:
        for file in distribution.files or []:
            source = Path(os.path.normpath(distribution.locate_file(file)))
            target = prefix / source.relative_to(sys.prefix)
            if "__pycache__" in target.parts or leave_out(source) or target.exists():
                continue
            target.parent.mkdir(parents=True, exist_ok=True)
            try:
                os.link(source, target)
            except OSError:
                shutil.copy2(source, target)


def site_packages(prefix):
    """Folder of the pure Python packages below a prefix."""
    return prefix / Path(sysconfig.get_path("purelib")).relative_to(sys.prefix)


def copy_source(target):
    """The project's files as a fresh clone has them."""
    shutil.copytree(REPOSITORY, target, ignore=NOT_IN_A_CLONE)
    return target


def pip_install(environment, requirement, variables, *options):
    """Install into a virtual environment without any index; returns pip's report."""
    report = environment / "report.json"
    command = [sys.executable, "-m", "pip", "--python", environment / "bin" / "python", "install"]
    command += ["--no-index", "--no-build-isolation", "--report", report, *options, requirement]
    # No settings of the machine, which may name other places to look in.
    settings = {**variables, "PIP_CONFIG_FILE": os.devnull}
    outcome = run(*command, variables=settings, folder=environment)
    assert outcome.returncode == 0, outcome.stdout + outcome.stderr
    return json.loads(report.read_text())


@pytest.fixture(scope="session")
def requires():
    """What the package's metadata requires, as a function of the extras that are asked for."""
    command = [sys.executable, "-m", "pip", "install", "--quiet", "--dry-run", "--no-deps"]
    command += ["--no-index", "--no-build-isolation", "--ignore-installed", "--report", "-"]
    outcome = run(*command, ".", variables=os.environ, folder=REPOSITORY)
    assert outcome.returncode == 0, outcome.stderr
    (package,) = json.loads(outcome.stdout)["install"]

    def select(*extras):
        found = map(Requirement, package["metadata"]["requires_dist"])
        return [str(requirement) for requirement in found if applies(requirement, extras)]

    return select


@pytest.fixture(scope="session")
def workspace(tmp_path_factory):
    """A colcon workspace with a clone of the project."""
    folder = tmp_path_factory.mktemp("workspace")
    copy_source(folder / "src" / PACKAGE)
    return folder


@pytest.fixture(scope="session")
def colcon(workspace):
    """Runs colcon in the workspace."""
    variables = plain_variables()
    variables["PATH"] = f"{Path(sys.prefix) / 'bin'}:{variables['PATH']}"

    def call(*arguments):
        outcome = run("colcon", *arguments, variables=variables, folder=workspace)
        assert outcome.returncode == 0, outcome.stdout + outcome.stderr
        return outcome.stdout

    return call


@pytest.fixture(scope="session")
def sourced(workspace):
    """The environment after sourcing a setup.bash of the workspace."""

    def source(folder):
        command = f"source {folder}/setup.bash && env -0"
        outcome = run("bash", "-c", command, variables=plain_variables(), folder=workspace)
        assert outcome.returncode == 0, outcome.stderr
        return dict(line.split("=", 1) for line in outcome.stdout.split("\0") if line)

    return source


@pytest.fixture(scope="session")
def colcon_installation(workspace, colcon, sourced):
    """`colcon build` and `source install/setup.bash`."""
    colcon("build")
    prefix = workspace / "install" / PACKAGE
    binaries = prefix / "lib" / PACKAGE
    return Installation(prefix, binaries, Path(sys.executable), sourced("install"))


@pytest.fixture(scope="session")
def make_pip_installation(tmp_path_factory):
    """`pip install .` with an extra, into an environment with no more than requirements."""

    def make(name, requirements, extra="", sourced=()):
        environment = tmp_path_factory.mktemp(name)
        venv.EnvBuilder(symlinks=True).create(environment)
        link(closure(["setuptools", *requirements]).values(), environment)
        source = copy_source(tmp_path_factory.mktemp("source") / PACKAGE)
        report = pip_install(
            environment, f"{source}{extra}", {**plain_variables(), **dict(sourced)}
        )
        binaries = environment / "bin"
        made = Installation(environment, binaries, binaries / "python", plain_variables())
        return made, report

    return make


@pytest.fixture(scope="session")
def wheels_installation(make_pip_installation, requires):
    """`pip install '.[ros]'` into an environment that has nothing beyond that extra."""
    return make_pip_installation("wheels", requires("ros"), "[ros]")[0]


@pytest.fixture(scope="session")
def system_ros(tmp_path_factory):
    """A ROS as apt lays it out: outside any environment and unknown to pip; its variables."""
    prefix = tmp_path_factory.mktemp("opt") / "ros" / "jazzy"
    distributions = closure(["ros-jazzy-rclpy[fastrtps]", "ros-jazzy-common-interfaces"])
    link(
        distributions.values(),
        prefix,
        leave_out=lambda path: any(
            part.endswith(".dist-info") or part.startswith("ros_wheels_bootstrapper")
            for part in path.parts
        ),
    )
    packages = site_packages(prefix)
    libraries = [prefix / "lib", *sorted(packages.glob("ros_*.libs"))]
    return {
        "AMENT_PREFIX_PATH": str(prefix),
        "LD_LIBRARY_PATH": ":".join(map(str, libraries)),
        "PYTHONPATH": str(packages),
        "ROS_DISTRO": "jazzy",
    }


@pytest.fixture(scope="session")
def without_opencv(make_pip_installation):
    """`pip install .` into an environment that has NumPy and nothing else."""
    return make_pip_installation("bare", ["numpy"])[0]


WithoutExtra = namedtuple("WithoutExtra", "installation report")


@pytest.fixture(scope="session")
def without_extra(make_pip_installation, requires, system_ros):
    """`pip install .` after sourcing a ROS from apt, called without having sourced it."""
    return WithoutExtra(*make_pip_installation("plain", requires("opencv"), sourced=system_ros))


@pytest.fixture(scope="session")
def apt_installation(without_extra, system_ros):
    """`pip install .` next to a ROS from apt, with that ROS sourced."""
    plain = without_extra.installation
    variables = {**plain.variables, **system_ros}
    return Installation(plain.prefix, plain.executables, plain.python, variables)


@pytest.fixture(params=["colcon", "wheels", "apt"])
def installation(request):
    """Each of the three ways to install the package."""
    return request.getfixturevalue(f"{request.param}_installation")


@pytest.fixture
def interrupt():
    """Ends a process as Ctrl-C does and returns its exit code."""

    def end(process):
        process.send_signal(signal.SIGINT)
        return process.wait(timeout=60)

    return end
