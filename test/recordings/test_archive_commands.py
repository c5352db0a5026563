"""The commands of docs/archives.md that one machine can run."""

import contextlib
import os
import re
import shutil
import signal
import socket
import subprocess
import sys
import tempfile
from pathlib import Path

import pytest
from common import QUICK, read_boxes

from pf_tracker_ros.recordings.target import Target, save_targets

DOCUMENT = Path(__file__).resolve().parents[2] / "docs" / "archives.md"
BLOCKS = re.findall(r"^```sh\n(.*?)^```", DOCUMENT.read_text(), re.MULTILINE | re.DOTALL)
COMMANDS = [line for block in BLOCKS for line in block.splitlines()]
TRACK = [line for line in COMMANDS if line.startswith("track ") and "s3://" not in line]
# Its cluster is started and ended by test_ray.py.
OWN_CLUSTER = "--ray local"
RAY = shutil.which("ray", path=str(Path(sys.executable).parent))


@pytest.fixture
def fleet(walkers, write_walkers, write_detections, detections_message, tmp_path):
    """A folder with one bag, which has a target file and detections, beside it and in a topic."""
    stamp = 10**9 + 3 * 40_000_000
    drive = write_walkers([(stamp + 2000, detections_message(stamp, walkers[1][3]))])
    folder = tmp_path / "fleet"
    folder.mkdir()
    drive = drive.rename(folder / drive.name)
    save_targets([Target(walkers[1][0][0], frame=0)], drive)
    write_detections((3, 7)).rename(folder / "drive.detections.csv")
    return folder


def arguments_of(line, fleet, output):
    """The arguments of a documented command, on other folders and in one process."""
    places = {"/data/fleet": fleet, "/data/boxes": output, "/yolo/detections": "/found", "8": "1"}
    return [*(str(places.get(each, each)) for each in line.split()[1:]), *QUICK]


@pytest.mark.parametrize("line", [line for line in TRACK if "--ray" not in line])
def test_each_command_without_ray(track, fleet, tmp_path, line):
    output = tmp_path / "boxes"
    code, said, errors = track(*arguments_of(line, fleet, output))
    assert code == 0, errors
    if "--dry-run" in line:
        assert "would track: " in said
        assert not output.exists()
    else:
        assert "1 tracked, 0 up to date, 0 failed" in said
        assert len(read_boxes(output / "drive")) >= 16


@pytest.fixture
def ray_head(monkeypatch):
    """Start Ray as documented, without a token, on another port; the address."""
    if RAY is None:
        pytest.skip("needs ray")
    with socket.create_server(("127.0.0.1", 0)) as server:
        address = f"127.0.0.1:{server.getsockname()[1]}"
    # Short, because it is part of the names of sockets.
    folder = tempfile.mkdtemp(prefix="ray_")
    (command,) = [line for line in COMMANDS if line.startswith("ray start --head")]
    alone = ("--block", f"--port={address[10:]}", f"--temp-dir={folder}")
    monkeypatch.delenv("RAY_AUTH_MODE", raising=False)
    settings = {"HOME": folder, "RAY_USAGE_STATS_ENABLED": "0", "RAY_ADDRESS": address}
    for name, value in settings.items():
        monkeypatch.setenv(name, value)
    process = subprocess.Popen(
        [RAY, *command.split()[1:], "--num-cpus=2", "--include-dashboard=false", *alone],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert any("Ray runtime started" in line for line in process.stdout)
    yield address
    process.terminate()
    process.communicate(timeout=60)
    # The processes of Ray that outlive it.
    with contextlib.suppress(ProcessLookupError):
        os.killpg(process.pid, signal.SIGKILL)
    shutil.rmtree(folder, ignore_errors=True)


def test_a_running_cluster_of_this_machine_is_used(ray_head, start_track, fleet, tmp_path):
    lines = [line for line in TRACK if "--ray" in line and OWN_CLUSTER not in line]
    assert [re.search(r"--ray (\S+)", line)[1] for line in lines] == ["auto", "127.0.0.1:6379"]
    for line in lines:
        given = arguments_of(line.replace("127.0.0.1:6379", ray_head), fleet, tmp_path / "boxes")
        said, errors = start_track(*given).communicate(timeout=120)
        assert errors == ""
    assert "1 recording: 1 tracked, 0 up to date, 0 failed" in said
    assert len(read_boxes(tmp_path / "boxes" / "drive")) == 16
