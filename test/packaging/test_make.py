"""`make` finds a fitting Python or says what is wrong; continuous integration runs all checks."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
CANDIDATES = ("python3.12", "python3.11", "python3.13", "python3.10", "python3")
# Stand-ins for interpreters, by what they do when they are asked.
UNSUPPORTED = "exit 1"
SUPPORTED_WITHOUT_PACKAGES = 'case "$2" in *import?ensurepip*|*import?pip*) exit 1;; esac'
SUPPORTED = 'if [ "$2" = venv ]; then echo "$(basename "$0") creates $3"; exit 7; fi'


@pytest.fixture
def clone(tmp_path):
    """What `make setup` reads, in a folder of its own."""
    folder = tmp_path / "clone"
    (folder / "requirements").mkdir(parents=True)
    for name in ("Makefile", "setup.py", "pyproject.toml"):
        shutil.copy2(REPOSITORY / name, folder)
    for name in ("bench.txt", "demo.txt", "development.txt", "environment.sh"):
        shutil.copy2(REPOSITORY / "requirements" / name, folder / "requirements")
    return folder


@pytest.fixture
def programs(tmp_path, monkeypatch):
    """Puts scripts on the path ahead of all others."""
    folder = tmp_path / "bin"
    folder.mkdir()
    monkeypatch.setenv("PATH", f"{folder}:{os.environ['PATH']}")
    monkeypatch.delenv("PYTHON", raising=False)

    def write(**scripts):
        for name, script in scripts.items():
            path = folder / name
            path.write_text(f"#!/bin/sh\n{script}\n")
            path.chmod(0o755)
        return folder

    return write


def make(folder, *arguments):
    # A make that runs these tests hands its flags and variables down.
    variables = {name: value for name, value in os.environ.items() if "MAKE" not in name}
    variables.pop("PYTEST_ARGS", None)
    return subprocess.run(
        ["make", *arguments], cwd=folder, env=variables, capture_output=True, text=True, check=False
    )


def test_make_alone_lists_the_targets(clone):
    listed = make(clone).stdout
    assert all(f"make {target} " in listed for target in ("setup", "test", "demo", "clean"))


@pytest.mark.parametrize(
    ("script", "reason"),
    [
        (UNSUPPORTED, "no Python from 3.10 to 3.13 found"),
        (SUPPORTED_WITHOUT_PACKAGES, "apt install python3-venv"),
    ],
)
def test_no_fitting_python_is_an_error_with_a_remedy(clone, programs, script, reason):
    programs(**dict.fromkeys(CANDIDATES, script))
    outcome = make(clone, "setup")
    assert outcome.returncode != 0
    assert reason in outcome.stderr


@pytest.mark.parametrize("first", CANDIDATES)
def test_the_first_fitting_python_is_taken(clone, programs, first):
    after = CANDIDATES.index(first)
    programs(**dict.fromkeys(CANDIDATES[:after], UNSUPPORTED))
    programs(**dict.fromkeys(CANDIDATES[after:], SUPPORTED))
    outcome = make(clone, "setup")
    assert outcome.returncode != 0
    assert f"{first} creates .venv" in outcome.stdout


@pytest.mark.parametrize(
    ("version", "fits"),
    [((3, 9), False), ((3, 10), True), ((3, 13), True), ((3, 14), False)],
)
def test_python_from_310_to_313_fits(clone, programs, version, fits):
    """What `environment.sh` asks of an interpreter, put to this one under another version."""
    pretended = f"import sys; sys.version_info = {version}; exec(sys.argv[1])"
    folder = programs(
        named=f'if [ "$1" = -c ]; then exec {sys.executable} -c "{pretended}" "$2"; fi\n{SUPPORTED}'
    )
    outcome = make(clone, "setup", f"PYTHON={folder}/named")
    assert ("named creates .venv" in outcome.stdout) is fits
    assert ("is not a Python from 3.10 to 3.13" in outcome.stderr) is not fits


@pytest.mark.parametrize("sequences", [[], ["SEQUENCES= "]])
def test_a_benchmark_without_sequences_is_an_error_that_says_how_to_name_them(clone, sequences):
    outcome = make(clone, "bench", *sequences)
    assert outcome.returncode != 0
    assert 'make bench SEQUENCES="FOLDER ..."' in outcome.stderr
    assert not (clone / ".venv-bench").exists()


@pytest.mark.parametrize(
    ("arguments", "parts", "last"),
    [
        (
            ["lock"],
            [f"--extra {extra} " for extra in ("ros", "evaluation", "test", "development")]
            + ["--universal --python-version 3.10"],
            "",
        ),
        (
            ["docs"],
            ["-m sphinx -W --keep-going"],
            'echo "the documentation: build/docs/index.html"',
        ),
        (
            ["bench", "SEQUENCES=one two", "BENCH_ARGS=--seeds 1"],
            ["environment.sh .venv-bench requirements/bench.txt"],
            ".venv-bench/bin/python benchmarks/peers.py one two --seeds 1",
        ),
        (
            ["test", "PYTEST_ARGS=-k some"],
            ["ruff check", "ruff format --check", "codespell", "mypy"],
            '-m "not slow" -k some',
        ),
        (["test-all"], ["mypy"], "-m pytest --numprocesses 2 --dist loadfile "),
    ],
    ids=lambda value: value[0] if isinstance(value, list) else "",
)
def test_the_commands_of_a_target(clone, arguments, parts, last):
    commands = make(clone, "--dry-run", *arguments).stdout
    for part in parts:
        assert part in commands
    assert commands.splitlines()[-1].endswith(last)


class Checks:
    """`.ci/run` in a repository of its own, where `make` and Python tell what they are asked."""

    def __init__(self, folder, make):
        self.folder = folder
        for name, script in {
            ".ci/run": (REPOSITORY / ".ci" / "run").read_text(),
            "make": make,
            "chromium": "exit 1",
            ".venv/bin/python": "#!/bin/sh\necho python $OPENBLAS_CORETYPE $@",
        }.items():
            path = folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            path.write_text(script if "/" in name else f"#!/bin/sh\n{script}\n")
            path.chmod(0o755)

    def git(self, *arguments):
        identity = ("-c", "user.name=a", "-c", "user.email=a@b.example")
        subprocess.run(["git", *identity, *arguments], cwd=self.folder, check=True)

    def commit(self, file):
        path = self.folder / file
        path.parent.mkdir(parents=True, exist_ok=True)
        path.write_text(f"{file} of another content")
        self.git("add", file)
        self.git("commit", "--quiet", f"--message={file}")

    def run(self):
        """The exit code and the lines that `make` and Python have printed."""
        outcome = subprocess.run(
            ["bash", ".ci/run"],
            cwd=self.folder,
            env={**os.environ, "PATH": f"{self.folder}:{os.environ['PATH']}"},
            capture_output=True,
            text=True,
            check=False,
        )
        return outcome.returncode, outcome.stdout.splitlines()


QUICK, ALL = "make test", "make test-all"
QUICK_PART, SLOW_PART = "pf_tracker_ros/boxes.py", "benchmarks/targets.py"


@pytest.fixture
def checks(tmp_path):
    found = Checks(tmp_path, "echo make $@")
    found.git("init", "--quiet", "--initial-branch=main")
    found.commit("README.md")
    return found


@pytest.mark.parametrize(
    ("branch", "changed", "suite"),
    [
        # Of the main branch, the last commit decides; of another, all.
        ("main", [SLOW_PART, QUICK_PART], QUICK),
        ("main", [QUICK_PART, SLOW_PART], ALL),
        ("other", [QUICK_PART, QUICK_PART + "c"], QUICK),
        ("other", [SLOW_PART, QUICK_PART], ALL),
    ],
)
def test_a_change_of_a_slow_part_decides_on_the_slow_tests(checks, branch, changed, suite):
    if branch == "other":
        checks.git("update-ref", "refs/remotes/origin/main", "HEAD")
    for file in changed:
        checks.commit(file)
    code, (first, second) = checks.run()
    assert (code, first) == (0, suite)
    assert second.startswith("python Prescott -m pytest")


def test_without_history_all_tests_run(checks):
    assert checks.run()[1][0] == ALL


def test_a_change_that_is_not_committed_counts(checks):
    checks.commit(SLOW_PART)
    checks.commit(QUICK_PART)
    (checks.folder / SLOW_PART).write_text("")
    assert checks.run()[1][0] == ALL


def test_a_failed_suite_ends_the_checks_with_its_exit_code(tmp_path):
    assert Checks(tmp_path, "exit 3").run() == (3, [])
