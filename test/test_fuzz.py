"""Inputs from anywhere, changed at random: each is taken, or refused with the error of its kind.

PF_TRACKER_FUZZ_SECONDS is the time of all kinds together, 60 by default. A failure names the number
of its input, which the same test draws again.
"""

import contextlib
import functools
import itertools
import json
import os
import struct
import sys
import time
import zlib
from importlib.metadata import EntryPoints
from pathlib import Path
from types import SimpleNamespace

import cv2
import numpy as np
import pytest

from pf_tracker_ros import registry
from pf_tracker_ros.decoding.depth_decoding import decode_depth
from pf_tracker_ros.decoding.image_decoding import ImageError
from pf_tracker_ros.evaluation.results import EvaluationError
from pf_tracker_ros.footage import FootageError, cdr, open_footage
from pf_tracker_ros.formats import FormatError, read_tracks
from pf_tracker_ros.networks.description import read_model
from pf_tracker_ros.networks.onnx_files import check_is_whole, network_path, with_output_shapes
from pf_tracker_ros.parameter_files import read_parameter_file
from pf_tracker_ros.parameters import ParameterError
from pf_tracker_ros.recordings import RecordingError
from pf_tracker_ros.recordings.archives.file_records import parse_record
from pf_tracker_ros.recordings.archives.tasks import _parse_entry
from pf_tracker_ros.recordings.detections import DetectionFile
from pf_tracker_ros.recordings.target import read_targets

SECONDS = float(os.environ.get("PF_TRACKER_FUZZ_SECONDS", "60"))
# Seconds after which an input counts as one without an end.
ENDLESS = 30

# What programs stumble over, in place of a number, a name or a part of a file.
ODD = [
    *(b"", b"\0", b"\xff\xfe", b"-1", b"0", b"1e999", b"nan", b"9" * 400, b"99999999", b"1_0"),
    *(b"true", b"null", b"[]", b"{}", b"[" * 2000, b'{"a":' * 2000, b"../..", b"/dev/zero", b"~"),
    *(b"*a", b"&a", b"!!python/name:os.system", b"<!DOCTYPE a>", b"\n", b"," * 50, b"=", b"%s{}"),
]


def changed(generator, content):
    """Bytes in which some places are removed, repeated or replaced."""
    content = bytearray(content)
    for _ in range(generator.integers(1, 5)):
        start = int(generator.integers(len(content) + 1))
        end = min(len(content), start + int(generator.choice([0, 1, 1, 4, 30, 300])))
        kind = generator.integers(4)
        if kind == 0:
            content[start:end] = ODD[generator.integers(len(ODD))]
        elif kind == 1:
            content[start:end] = bytes(content[start:end]) * int(generator.integers(3))
        elif kind == 2:
            content[start:end] = generator.bytes(end - start)
        else:
            # A whole number or word of a text.
            words = bytes(content).replace(b",", b" ").replace(b":", b" ").split()
            if words:
                word = words[generator.integers(len(words))]
                content = bytearray(content.replace(word, ODD[generator.integers(len(ODD))], 1))
    return bytes(content)


def file_reader(name, read):
    """Reads a file of this name with the content."""

    def take(content, folder):
        (folder / name).write_bytes(content)
        read(folder / name)

    return take


def decode(message, content, folder):
    """Depth whose fields are in the first bytes; test/decoding does so for images."""
    head = struct.Struct("<HHHB")
    head_bytes, data = content[: head.size].ljust(head.size, b"\0"), content[head.size :]
    height, width, step, kind = head.unpack(head_bytes)
    encodings = ["mono16", "16UC1", "32FC1", "8UC4\0", ""]
    formats = ["png", "16UC1; compressedDepth png", ""]
    fields = {"data": memoryview(data), "format": formats[kind % len(formats)]}
    if message == "image":
        fields = {"data": fields["data"], "height": height, "width": width, "step": step}
        fields |= {"encoding": encodings[kind % len(encodings)], "is_bigendian": kind}
    with contextlib.suppress(ImageError):
        decode_depth(SimpleNamespace(**fields), 10**6)


def deserialize(content, folder):
    for read in (
        *(cdr.deserialize_image, cdr.deserialize_compressed_image, cdr.deserialize_polygon),
        *(cdr.deserialize_detections, cdr.deserialize_camera_info, cdr.deserialize_odometry),
        *(cdr.deserialize_imu, cdr.deserialize_transforms, cdr.header_stamp),
    ):
        with contextlib.suppress(FootageError):
            read(content)


def read_status(content, folder):
    """A status with a key and a value in each line."""
    pytest.importorskip("rclpy")
    from diagnostic_msgs.msg import DiagnosticArray, DiagnosticStatus, KeyValue
    from visualization_msgs.msg import Marker

    from pf_tracker_ros.node.localizer.tracker_status import read_status

    message = DiagnosticArray()
    for part in content.decode("utf-8", "replace").split("---"):
        pairs = [line.partition("=") for line in part.splitlines()]
        values = [KeyValue(key=key, value=value) for key, _, value in pairs]
        message.status.append(DiagnosticStatus(values=values))
    frame, _ = read_status(message)
    for target in frame.targets:
        assert 0.0 <= target.confidence <= 1.0
        assert np.isfinite([*target.box, *target.box_covariance.ravel()]).all()
        Marker(id=target.id)


def read_done(content, folder):
    text = content.decode("utf-8", "replace")
    parse_record(text, done=True)
    entry = _parse_entry(text)
    assert entry is None or json.dumps(entry.states)


def read_journal(content, folder):
    pytest.importorskip("optuna")
    from pf_tracker_ros.tuning.journal import open_journal

    (folder / "mine.journal").write_bytes(content)
    with open_journal(folder / "mine.journal"):
        pass


def read_entry_points(content, folder):
    """The metadata of a package beside those that are installed."""
    info = folder / "odd-1.0.dist-info"
    info.mkdir(exist_ok=True)
    (info / "METADATA").write_bytes(content.partition(b"---")[0])
    (info / "entry_points.txt").write_bytes(content.partition(b"---")[2])
    before = sys.path[:]
    sys.path[:] = [str(folder)]
    try:
        found = registry._installed_entry_points.__wrapped__()
        assert isinstance(found.select(group="pf_tracker_ros.cues"), EntryPoints)
    finally:
        sys.path[:] = before


def read_description(path):
    description, folder = read_model(str(path))
    file = description.embedding.file
    assert network_path(folder, file).is_relative_to(folder)


def read_network(content, folder):
    check_is_whole(content)
    with_output_shapes(content)


def encoded(suffix, image):
    return cv2.imencode(suffix, image)[1].tobytes()


def line_of_journal():
    from pf_tracker_ros.tuning.journal import _next_hash

    entry = {"op_code": 0, "worker_id": "a", "study_name": "run", "directions": [2]}
    return json.dumps({**entry, "hash": _next_hash("", entry)}).encode() + b"\n"


STATUS = b"""\
state=tracking
selected=1
image_width=640
image_height=480
---
id=1
label=person
state=tracking
confidence=0.9
""" + b"".join(
    b"%s=%d\n" % (name, 10 + number)
    for number, name in enumerate(
        (b"box_x", b"box_y", b"box_width", b"box_height")
        + tuple(b"covariance_" + axes for axes in (b"xx", b"yy", b"ww", b"hh"))
    )
)
TARGETS = b"""\
targets:
- {target_box: [10, 20, 30, 40], frame: 3, stamp: 5, label: car}
- keyframes:
  - {frame: 0, box: [1, 2, 30, 40]}
  - {frame: 7, absent: true}
recording: drive.mcap
image_size: [640, 480]
"""
CVAT = b"""\
<annotations><track id="0" label="car">
<box frame="2" keyframe="1" outside="0" occluded="0" xtl="10.0" ytl="20.5" xbr="30" ybr="50"/>
<box frame="7" keyframe="1" outside="1" occluded="0" xtl="12.0" ytl="20.5" xbr="32" ybr="50"/>
</track></annotations>
"""
COCO = json.dumps(
    {
        "images": [{"id": 1, "frame_id": 0, "width": 64, "height": 48, "file_name": "0.png"}],
        "annotations": [{"id": 1, "image_id": 1, "category_id": 1, "bbox": [1, 2, 3, 4],
                         "track_id": 1}],
        "categories": [{"id": 1, "name": "car"}],
    }
).encode()  # fmt: skip
DONE = json.dumps(
    {
        **{"name": "drive", "source": "/drive", "key": "0", "exit_code": 0, "error": ""},
        **{"frames": 3, "states": {"tracking": 3}, "warnings": [], "files": {"boxes.csv": "0"}},
        "kept": [],
    }
).encode()
POINTS = b"""\
Metadata-Version: 2.1
Name: odd
Version: 1.0
---[pf_tracker_ros.cues]
odd = odd_things:Odd
[console_scripts]
odd = odd_things:main
"""
PARAMETERS = b"""\
/**/pf_tracker:
  ros__parameters:
    preset: default
    particles: 300
    cues: [color_contrast, hog]
"""
IMAGE = np.arange(192, dtype=np.uint8).reshape(8, 8, 3)
RAW = struct.pack("<HHHB", 8, 8, 16, 1) + IMAGE.tobytes()[:128]
DEPTH = struct.pack("<HHHB", 0, 0, 0, 1) + struct.pack("<Iff", 0, 1.0, 0.1)
DEPTH += encoded(".png", IMAGE[:, :, 0].astype(np.uint16))
# A PolygonStamped with a point, and an Image of two bytes.
POLYGON = struct.pack("<4sII I2sxx I3f", b"\0\1\0\0", 1, 2, 2, b"a\0", 1, 1.0, 2.0, 0.0)
MESSAGE = struct.pack("<4sII I2sxx II", b"\0\1\0\0", 1, 2, 2, b"a\0", 1, 2)
MESSAGE += struct.pack("<I6s Bx II 2s", 6, b"mono8\0", 0, 2, 2, b"ab")
# A model with a graph of a node and a tensor.
NETWORK = bytes.fromhex("0807 3a19 0a0c 0a0178 120179 220452656c75 2a09 0801 1001 420177 7000")

read_label_file = file_reader("boxes", read_tracks)
read_target_file = file_reader("a.target.yaml", lambda path: read_targets(path, Path("drive.mcap")))


def read_ground_truth(content, folder):
    (folder / "img").mkdir(exist_ok=True)
    (folder / "img" / "0.png").write_bytes(encoded(".png", IMAGE))
    (folder / "groundtruth.txt").write_bytes(content.partition(b"---")[0])
    (folder / "meta.json").write_bytes(content.partition(b"---")[2])
    open_footage(folder)


# Kind of an input to valid contents, their reader, and the errors that refuse others.
KINDS = {
    "raw depth": ([RAW], functools.partial(decode, "image"), ()),
    "compressed depth": ([DEPTH], functools.partial(decode, "compressed"), ()),
    "serialized message": ([POLYGON, MESSAGE], deserialize, ()),
    "status": ([STATUS], read_status, ValueError),
    "label file": (
        [CVAT, COCO, b"1,1,10,20,30,40,0.9,1,1\n2,1,11,20,30,40,0.9,1,1\n",
         b"frame,id,x,y,width,height,state,confidence,label\n0,1,1,2,3,4,tracking,0.9,car\n",
         b"0 1 Car 0 0 -10 10 20 30 40 -1 -1 -1 -1000 -1000 -1000 -10\n"],
        read_label_file, FormatError,
    ),
    "target file": ([TARGETS], read_target_file, RecordingError),
    "detections": (
        [b"1,-1,10,20,30,40,0.9,car\n2\n"], file_reader("d.csv", DetectionFile), RecordingError,
    ),
    "ground truth": ([b'1,2,3,4\n---{"name": "a"}'], read_ground_truth, FootageError),
    "parameter file": (
        [PARAMETERS], file_reader("p.yaml", read_parameter_file), ParameterError,
    ),
    "model.yaml": (
        [b"name: colors\nmean: [1.0, 2.0, 3.0]\nembedding: {file: colors.onnx, rows: 2}\n"],
        file_reader("model.yaml", read_description), ParameterError,
    ),
    "network": ([NETWORK], read_network, (ValueError, IndexError)),
    "journal": ([b"", line_of_journal], read_journal, EvaluationError),
    "done.json": ([DONE], read_done, ()),
    "plug-in metadata": ([POINTS], read_entry_points, ()),
}  # fmt: skip


@pytest.mark.slow
@pytest.mark.parametrize("kind", KINDS)
def test_any_input_is_taken_or_refused(kind, tmp_path, start_alarm, caplog):
    contents, read, refusals = KINDS[kind]
    if kind == "journal":
        pytest.importorskip("optuna")
    contents = [content() if callable(content) else content for content in contents]
    # The valid ones are taken.
    for content in contents:
        read(content, tmp_path)
    end = time.monotonic() + SECONDS / len(KINDS)
    for number in itertools.count():
        if time.monotonic() > end:
            break
        generator = np.random.default_rng([zlib.crc32(kind.encode()), number])
        content = changed(generator, contents[generator.integers(len(contents))])
        start_alarm(ENDLESS)
        try:
            read(content, tmp_path)
        except refusals:
            pass
        except Exception as error:
            raise AssertionError(f"input {number}: {content[:2000]!r}") from error
        caplog.clear()
