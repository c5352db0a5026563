"""Files of a network from an unknown source: refused with a reason, and nothing waits for them."""

import os
import threading
from importlib.util import find_spec

import numpy as np
import pytest
from embedding_networks import EMBEDDING, SIDE
from small_networks import field, network, node, value

from pf_tracker_ros.networks import engines, onnx_files
from pf_tracker_ros.networks.description import read_model
from pf_tracker_ros.networks.embedding import EmbeddingNetwork
from pf_tracker_ros.networks.engines import load_network
from pf_tracker_ros.parameters import ParameterError

FILE = "colors.onnx"
HAS_RUNTIME = find_spec("onnxruntime") is not None
LOADERS = ["opencv", *(["onnxruntime"] if HAS_RUNTIME else [])]


def replace_by(make):
    def spoil(folder):
        (folder / FILE).unlink()
        make(folder / FILE)

    return spoil


def link_out(folder):
    (folder / FILE).rename(folder.parent / "elsewhere.onnx")
    (folder / FILE).symlink_to("../elsewhere.onnx")


def named(name):
    def spoil(folder):
        path = folder / "model.yaml"
        path.write_text(path.read_text().replace(f"file: {FILE}", f'file: "{name}"'))

    return spoil


NOT_THERE = "is not in the folder .*embedding of its description; copy it there"


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (replace_by(os.mkfifo), f"{FILE} is a FIFO; accepted are regular files"),
        (replace_by(lambda path: path.mkdir()), f"{FILE} is a folder; accepted are regular files"),
        (replace_by(lambda path: path.symlink_to("/dev/zero")), NOT_THERE),
        (link_out, NOT_THERE),
        (named("../embedding/colors.onnx"), NOT_THERE),
        (named("/etc/passwd"), NOT_THERE),
        (named("a\\0b"), NOT_THERE),
    ],
)
def test_only_regular_files_in_the_folder_are_read(model, spoil, message):
    spoil(model)
    with pytest.raises(ParameterError, match=message):
        EmbeddingNetwork(str(model), "opencv")


def test_links_within_the_folder_are_followed(model):
    (model / FILE).rename(model / "weights")
    (model / FILE).symlink_to("weights")
    EmbeddingNetwork(str(model), "opencv")


def test_a_large_file_is_not_read(model, monkeypatch):
    monkeypatch.setattr(onnx_files, "_MAX_BYTES", 1000)
    with pytest.raises(ParameterError, match="is larger than 1000 bytes, the most allowed"):
        EmbeddingNetwork(str(model), "opencv")


@pytest.mark.parametrize("name", ["template", "weights", "a\\0b", "/dev/zero"])
def test_a_description_of_any_text_is_refused_in_a_sentence(tmp_path, name):
    with pytest.raises(ParameterError, match=r"cannot be read|is no path"):
        read_model(str(tmp_path / name.replace("\\0", "\0")))


TENSOR = field(13, field(1, "location") + field(2, "weights.bin")) + field(14, 1)
# Fields of a model to the tensor: graph 7, node 1, attribute 5, tensor 5, and so on.
PLACES = [
    (7, 5),
    (7, 15, 1),
    (7, 15, 2),
    (7, 1, 5, 5),
    (7, 1, 5, 10),
    (7, 1, 5, 22, 1),
    (7, 1, 5, 6, 5),
    (7, 1, 5, 11, 1, 5, 5),
    (20, 1, 5),
    (20, 2, 5),
    (25, 7, 5, 5),
    (25, 11, 6, 5),
]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("engine", LOADERS)
def test_weights_in_another_file_are_refused(model, place, engine):
    """Engines would read them from the working directory, and the hash is not of them."""
    content = TENSOR
    for number in reversed(place):
        content = field(number, content)
    path = model / FILE
    path.write_bytes(path.read_bytes() + content)
    with pytest.raises(ParameterError, match="weights in another file; export it with all"):
        EmbeddingNetwork(str(model), engine)


LARGE_FILE = b"version https://git-lfs.github.com/spec/v1"


@pytest.mark.parametrize(
    "content", [b"\xff" * 10**6, b"\x08" * 99, b"\x3a\xff\xff\xff\xff\x0f", LARGE_FILE]
)
@pytest.mark.parametrize("engine", LOADERS)
def test_bytes_that_are_no_network_are_refused(model, content, engine):
    (model / FILE).write_bytes(content)
    with pytest.raises(ParameterError, match="cannot be read as a network in the ONNX format"):
        EmbeddingNetwork(str(model), engine)


@pytest.fixture
def short_limit(monkeypatch):
    monkeypatch.setattr(engines, "_TIME_LIMIT", 0.2)


class Endless:
    """An engine that waits, on loading or in each run, until it is stopped."""

    def __init__(self, content):
        self.runs = 0
        self.stopped = threading.Event()

    def run(self, inputs, outputs):
        self.runs += 1
        self.stopped.wait()
        raise RuntimeError("terminated")

    def stop(self):
        self.stopped.set()


def test_a_run_without_an_end_is_refused_and_not_repeated(
    write_embedding, short_limit, monkeypatch
):
    # Of another name than those that have run before.
    model = write_embedding(description=EMBEDDING.replace("mean colors", "without an end"))
    monkeypatch.setitem(engines._ENGINES, "opencv", Endless)
    for reason in ("it takes more than 0.2 s", "an earlier run took more than 0.2 s"):
        with pytest.raises(ParameterError, match=f"cannot run {FILE} as its .*{reason}"):
            EmbeddingNetwork(str(model), "opencv")
    engine = load_network(model / FILE, "opencv")._engine
    assert (engine.runs, engine.stopped.is_set()) == (1, True)


def test_loading_without_an_end_is_refused(model, short_limit, monkeypatch):
    release = threading.Event()
    monkeypatch.setitem(engines._ENGINES, "opencv", lambda content: release.wait())
    with pytest.raises(ParameterError, match=r"cannot be read .* by opencv .it takes more than"):
        EmbeddingNetwork(str(model), "opencv")
    release.set()


def endless():
    """The bytes of an embedding network with a loop of 10**12 iterations."""
    body = field(1, node("Identity", ["condition"], "go_on"))
    body += field(1, node("Identity", ["before"], "after")) + field(2, "body")
    for number, names in ((11, ("iteration", "condition", "before")), (12, ("go_on", "after"))):
        for name in names:
            # Without dimensions; the elements are whole numbers, truth values or floats.
            element = {"iteration": 7, "condition": 9, "go_on": 9}.get(name, 1)
            dimensions = b"" if element == 1 else field(2, b"")
            kind = field(1, element) + dimensions
            body += field(number, field(1, name) + field(2, field(1, kind)))
    loop = field(5, field(1, "body") + field(6, body) + field(20, 5))
    times = field(2, 7) + field(8, "times") + field(9, np.int64(10**12).tobytes())
    shape = (1, 3, 2 * SIDE, SIDE)
    return network(
        [node("Loop", ["times", "", "input"], "output", loop)],
        [times],
        [value("input", shape)],
        [value("output", shape)],
    )


@pytest.mark.skipif(not HAS_RUNTIME, reason="no ONNX Runtime")
def test_a_loop_without_an_end_is_stopped_with_its_thread(write_embedding, short_limit):
    folder = write_embedding(endless())
    with pytest.raises(ParameterError, match=r"cannot run colors\.onnx as .*it takes more than"):
        EmbeddingNetwork(str(folder), "onnxruntime")
    for thread in threading.enumerate():
        if thread.name == "network":
            thread.join(60)
            assert not thread.is_alive()
