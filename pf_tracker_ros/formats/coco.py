"""COCO JSON with videos, as COCO-VID, TAO and CVAT write it.

`images` has an entry for each frame, and each entry of `annotations` has a track id. Frames count
from 0: `frame_id` or `frame_index` of the image, else the number at the end of its file name. The
track id is `track_id` or `instance_id` of the annotation, or `track_id` of its attributes. A target
is absent in listed images without an annotation of it.
See https://cocodataset.org/#format-data and https://github.com/TAO-Dataset/tao.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping, Sequence
from itertools import pairwise
from pathlib import Path, PurePosixPath
from typing import Any

from pf_tracker_ros.formats.tracks import (
    UNLABELED,
    BoxTrack,
    FormatError,
    LabeledBox,
    RecordingInfo,
    TracksBuilder,
    as_number,
    as_whole,
    four_numbers,
    present_boxes,
    read_text,
    rounded,
)


def read_coco(path: Path) -> tuple[BoxTrack, ...]:
    """Read a file of one video; raises FormatError."""
    try:
        document = json.loads(read_text(path))
    except (ValueError, RecursionError) as error:
        if isinstance(error, FormatError):
            raise
        raise FormatError(f"{path} cannot be read as JSON: {error}") from error
    images = _entries(path, document, "images")
    annotations = _entries(path, document, "annotations")
    labels = {
        str(each.get("id")): str(each.get("name", ""))
        for each in _entries(path, document, "categories", required=False)
    }
    videos = {str(image.get("video_id")) for image in images}
    if len(videos) > 1:
        raise FormatError(f"{path} has the images of {len(videos)} videos; allowed: one")
    frames: dict[Any, int] = {}
    for number, image in enumerate(images):
        try:
            frames[_key(image, "id")] = _frame(image)
        except ValueError as error:
            raise FormatError(f"{path}, 'images' entry {number}: {error}") from error
    tracks = TracksBuilder(path)
    seen: dict[int, set[int]] = {}
    for number, annotation in enumerate(annotations):
        try:
            image_id = _key(annotation, "image_id")
            if image_id not in frames:
                raise ValueError(f"'image_id' is {image_id!r}, which no entry of 'images' has")
            id = _track_id(annotation)
            label = labels.get(str(annotation.get("category_id")), "")
            tracks.add(id, frames[image_id], _labeled(annotation), label)
            seen.setdefault(id, set()).add(frames[image_id])
        except ValueError as error:
            raise FormatError(f"{path}, 'annotations' entry {number}: {error}") from error
    # An absence holds until the next box: its first frame suffices.
    following = dict(pairwise(sorted({*frames.values()})))
    for id, present in seen.items():
        for frame in {following[each] for each in present if each in following} - present:
            tracks.add(id, frame, LabeledBox(None))
    return tracks.tracks()


def write_coco(path: Path, tracks: Sequence[BoxTrack], info: RecordingInfo) -> None:
    """Write a file, with an image for each frame of the recording."""
    labels = sorted({track.label or UNLABELED for track in tracks})
    categories = {label: number for number, label in enumerate(labels, start=1)}
    width, height = info.size_at(0)
    images = [
        {
            "id": frame + 1,
            "video_id": 1,
            "frame_id": frame,
            "file_name": f"frame_{frame:06d}.png",
            "width": size[0],
            "height": size[1],
        }
        for frame in range(info.frame_count)
        for size in [info.size_at(frame)]
    ]
    annotations: list[dict[str, Any]] = []
    for frame, track, labeled, box in present_boxes(tracks):
        annotation: dict[str, Any] = {
            "id": len(annotations) + 1,
            "video_id": 1,
            "image_id": frame + 1,
            "category_id": categories[track.label or UNLABELED],
            "track_id": track.id,
            "bbox": [rounded(value) for value in box],
            "area": rounded(box[2] * box[3]),
            "iscrowd": 0,
            "occluded": labeled.occluded,
        }
        if not math.isnan(labeled.confidence):
            annotation["score"] = round(labeled.confidence, 4)
        annotations.append(annotation)
    document = {
        "videos": [{"id": 1, "name": info.name, "width": width, "height": height}],
        "categories": [{"id": number, "name": name} for name, number in categories.items()],
        "images": images,
        "annotations": annotations,
    }
    path.write_text(json.dumps(document), encoding="utf-8")


def _entries(
    path: Path, document: Any, name: str, *, required: bool = True
) -> list[Mapping[str, Any]]:
    entries = document.get(name, None if required else []) if isinstance(document, dict) else None
    if not isinstance(entries, list) or not all(isinstance(each, dict) for each in entries):
        raise FormatError(
            f"{path}: {name!r} is {type(entries).__name__}; allowed in COCO JSON: an object with "
            "lists of objects 'images', 'annotations' and 'categories'"
        )
    return entries


def _key(entry: Mapping[str, Any], name: str) -> int | str:
    value = entry.get(name)
    if not isinstance(value, int | str):
        raise ValueError(f"{name!r} is {value!r}; allowed: a number")
    return value


def _frame(image: Mapping[str, Any]) -> int:
    for name in ("frame_id", "frame_index"):
        if name in image:
            return as_whole(image[name], f"{name!r}")
    stem = PurePosixPath(str(image.get("file_name", ""))).stem
    digits = re.search(r"\d+$", stem)
    if digits is None:
        raise ValueError(
            "it has no frame; allowed: 'frame_id', 'frame_index' or a number at the end of "
            f"'file_name', which is {image.get('file_name')!r}"
        )
    return as_whole(digits.group(), "the number of 'file_name'")


def _track_id(annotation: Mapping[str, Any]) -> int:
    attributes = annotation.get("attributes")
    inner = attributes if isinstance(attributes, dict) else {}
    for holder, name in (
        (annotation, "track_id"),
        (annotation, "instance_id"),
        (inner, "track_id"),
    ):
        if name in holder:
            return as_whole(holder[name], f"{name!r}")
    raise ValueError("it has no 'track_id'; boxes of single images are no tracks")


def _labeled(annotation: Mapping[str, Any]) -> LabeledBox:
    bbox = annotation.get("bbox")
    if not isinstance(bbox, list) or len(bbox) != 4:
        raise ValueError(f"'bbox' is {bbox!r}; allowed: [x, y, width, height] in pixels")
    attributes = annotation.get("attributes")
    inner = attributes if isinstance(attributes, dict) else {}
    score = annotation.get("score")
    return LabeledBox(
        four_numbers(bbox, ("x", "y", "the width", "the height")),
        occluded=bool(annotation.get("occluded", inner.get("occluded", False))),
        confidence=math.nan if score is None else as_number(score, "'score'"),
        is_keyframe=bool(inner.get("keyframe", True)),
    )
