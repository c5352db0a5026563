"""Recordings damaged at random: nothing crashes or hangs, and what is missing is told."""

import os
import shutil

import cv2
import numpy as np
import pytest
from common import read_boxes

CASES = int(os.environ.get("PF_TRACKER_CASES", "0"))
KINDS = ("mp4", "mkv", "avi", "mcap", "sqlite3", "folder")
# These have a list of their frames, so a missing one is noticed.
LISTED = KINDS[:1] + KINDS[2:]
REQUEST = ("--box", "20,30,24,24", "--preset", "li2007", "--parameter", "particles=20")


@pytest.fixture
def whole(request, moving_square, write_clip, write_images_bag, tmp_path):
    """The moving square as a recording of the requested kind, and its kind."""
    kind, images = request.param, moving_square.images
    if kind == "folder":
        path = tmp_path / "square"
        path.mkdir()
        for index, image in enumerate(images):
            assert cv2.imwrite(str(path / f"{index}.png"), image)
    elif kind in ("mcap", "sqlite3"):
        path = write_images_bag("square", images, range(len(images)), kind.upper())
    else:
        times = range(0, 40 * len(images), 40)
        options = {"movflags": "faststart"} if kind == "mp4" else {}
        path = write_clip(tmp_path / f"square.{kind}", images, times, container_options=options)
    return path, kind


def damage(path, random):
    """Cut a file, overwrite or insert a part of it, or change some octets."""
    content = bytearray(path.read_bytes())
    begin = int(random.integers(len(content)))
    end = begin + int(random.integers(1, 1 + len(content) // 4))
    way = random.integers(5)
    if way == 0:
        content = content[:begin]
    elif way == 1:
        content[begin:end] = bytes(len(content[begin:end]))
    elif way == 2:
        content[begin:begin] = random.bytes(2000)
    else:
        reach = 600 if way == 3 else len(content)
        for place in random.integers(0, min(reach, len(content)), 5):
            content[place] ^= int(random.integers(1, 256))
    path.write_bytes(content)


@pytest.mark.parametrize("whole", KINDS, indirect=True)
def test_damage_is_told(whole, track, start_alarm, tmp_path):
    source, kind = whole
    assert track(source, "--output", tmp_path / "whole", *REQUEST)[::2] == (0, "")
    expected = [row["stamp"] for row in read_boxes(tmp_path / "whole")]
    assert len(expected) == 20
    for seed in range(max(2, CASES // len(KINDS))):
        random = np.random.default_rng(seed)
        damaged, output = tmp_path / f"damaged_{seed}{source.suffix}", tmp_path / f"out_{seed}"
        if source.is_dir():
            shutil.copytree(source, damaged)
            damage(random.choice(sorted(damaged.iterdir())), random)
        else:
            shutil.copy(source, damaged)
            damage(damaged, random)
        start_alarm(60)
        code, said, errors = track(damaged, "--output", output, *REQUEST)
        assert code in (0, 3, 7), (seed, errors)
        assert [line for line in errors.splitlines() if not line.startswith("track: ")] == []
        assert bool(said) == (code == 0)
        if not errors:
            found = [row["stamp"] for row in read_boxes(output)]
            assert len(found) == 20 or kind not in LISTED, seed
            # The header of a message in a bag has no checksum.
            assert source.is_dir() or set(found) <= set(expected), seed
