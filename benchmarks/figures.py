"""The figures of README and docs: one run of all benchmarks at one commit, and the tables from it.

    make figures FOOTAGE=FOLDER                        # measure all, hours; write JSON and tables
    python benchmarks/figures.py measure FOLDER --only peers --seeds 1
    python benchmarks/figures.py write                 # the tables of the documents, from the JSON

`FOLDER/sequences` has sequence folders, and `FOLDER/mot` folders of the MOT challenge. The frames
of `mot/NAME` are the images in its `img1`, or the video `FOLDER/sequences/video/NAME.*`.
`FOLDER/world` has what world.py takes: `kitti`, a folder with `*_depth.png`, `calibration.xml`.
What is absent is left out, which is said before the first part. `docs/figures.json` keeps what
another run has measured of the parts that this one leaves out, each with its commit.

A document names a table between two comments; the first has its part and the beginning of its
title, and optionally columns and rows:

    <!-- figures peers: Presets | columns: tracker, AUC | rows: default, CSRT -->
    <!-- end of figures -->
"""

from __future__ import annotations

import argparse
import importlib.util
import json
import os
import platform
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from datetime import datetime, timezone
from importlib.metadata import PackageNotFoundError, version
from pathlib import Path
from typing import Any

import arguments as options_of
from tables import TABLES_FILE, Table

ROOT = Path(__file__).resolve().parents[1]
FIGURES = Path("docs") / "figures.json"
DOCUMENTS = ("README.md", "docs/benchmarks.md", "docs/performance.md", "docs/world.md")
PACKAGES = ("numpy", "scipy", "opencv-contrib-python-headless", "opencv-python-headless")
PACKAGES += ("dlib-bin", "onnxruntime", "trackeval", "trackers")
# Kinds of footage, by the beginnings of the sequences' names.
KINDS = {
    "color": "otb_|uav_|tld_car|vot_",
    "pedestrians": "pets_|tud_|tld_ped",
    "thermal": "tir_",
    "aircraft, birds": "ir|vbird|vdrone",
}
INFRARED = "tir_|ir"
END = "<!-- end of figures -->"
_BLOCK = re.compile(rf"<!-- figures (.+?) -->\n(.*?){END}", re.DOTALL)

Command = list[str]
# From the folder of footage and the number of seeds to commands; none where footage is absent.
Part = Callable[[Path, int], list[Command]]


class FiguresError(ValueError):
    """A table is named that has not been measured, or the footage is missing."""


def _on_sequences(script: str, *options: str, seeds: int, only: str = "") -> Part:
    """A benchmark of the sequences, or of those whose name matches, with at most so many seeds."""

    def commands(footage: Path, given: int) -> list[Command]:
        folder = footage / "sequences"
        folders = [folder] if folder.is_dir() else []
        if only:
            folders = sorted(one for one in folder.glob("*/") if re.match(only, one.name))
        counted = ["--seeds", str(min(given, seeds))]
        return [[script, *map(str, folders), *options, *counted]] if folders else []

    return commands


def _always(*commands: str) -> Part:
    return lambda footage, seeds: [command.split() for command in commands]


def _several_targets(*options: str) -> Part:
    def commands(footage: Path, seeds: int) -> list[Command]:
        words: list[str] = []
        for folder in sorted(path.parent for path in footage.glob("mot/*/seqinfo.ini")):
            if frames := _frames_of(folder, footage / "sequences" / "video"):
                words += ["--sequence", str(folder), str(frames)]
        return [["targets.py", *words, *options, "--seed", str(seed)] for seed in range(seeds)
                if words]  # fmt: skip

    return commands


def _frames_of(folder: Path, videos: Path) -> Path | None:
    """The images of a folder of the MOT challenge, or else the video with its name, if any."""
    if (images := folder / "img1").is_dir():
        return images
    video = next((one for one in sorted(videos.glob("*")) if one.stem == folder.name), None)
    if video is None:
        _leave_out(folder.name, f"neither {images} nor {videos / folder.name}.* exists")
    return video


def _positions(footage: Path, seeds: int) -> list[Command]:
    world, pets = footage / "world", footage / "mot" / "PETS09-S2L1"
    words: list[str] = []
    if (world / "kitti").is_dir():
        words += ["--kitti", str(world / "kitti")]
    if frame := min(world.glob("*/*_depth.png"), default=None):
        words += ["--depth", str(frame.parent)]
    if (calibration := world / "calibration.xml").exists() and pets.is_dir():
        words += ["--pets", str(pets), "--calibration", str(calibration)]
    elif pets.is_dir():
        _leave_out("positions of PETS09-S2L1", f"{calibration} does not exist")
    return [["world.py", "--cost", *words]] if words else []


def _leave_out(what: str, reason: str) -> None:
    print(f"{what} is left out: {reason}", file=sys.stderr)


_GROUPS = [word for kind in KINDS.items() for word in ("--group", "=".join(kind))]
PARTS: Mapping[str, Part] = {
    "peers": _on_sequences("peers.py", seeds=1),
    "confidence": _on_sequences("uncertainty.py", *_GROUPS, seeds=1),
    "covariance": _on_sequences("box_covariance.py", seeds=3),
    "honesty": _on_sequences("honesty.py", seeds=1),
    "targets": _several_targets(),
    "targets, moving camera": _several_targets("--moving-camera"),
    "positions": _positions,
    "following a person": _always("follow.py --seeds 100 2"),
    "frame cost": _always("frame_cost.py"),
    "cost of several targets": _always(
        "multi_target_cost.py", "multi_target_cost.py --size 1920x1080"
    ),
    "node": _always("node.py", "node.py --large-images", "node.py --realtime-priority 1"),
    "umbrellas": _always("umbrellas.py"),
    "infrared": _on_sequences("infrared.py", seeds=3, only=INFRARED),
    "families": _always("families.py"),
    "growth model": _always("growth_model.py"),
}


# Part to the picture that it writes, and its name in docs.
PICTURES = {
    "peers": ("peers.png", "success.png"),
    "confidence": ("uncertainty.png", "uncertainty.png"),
    "targets": ("targets.png", "targets.png"),
    "targets, moving camera": ("targets.png", "targets_moving.png"),
}


def measure(part: str, commands: Sequence[Command], pictures: Path) -> list[dict[str, Any]]:
    """Run the commands of a part; returns its tables.

    Raises:
        FiguresError: A benchmark has failed.
    """
    found: list[dict[str, Any]] = []
    # Packages that are installed elsewhere, such as trackeval, stay visible.
    paths = [str(ROOT), *filter(None, [os.environ.get("PYTHONPATH")])]
    with tempfile.TemporaryDirectory() as folder:
        tables = Path(folder) / "tables.jsonl"
        tables.touch()
        environment = os.environ | {"PYTHONPATH": os.pathsep.join(paths), TABLES_FILE: str(tables)}
        for script, *rest in commands:
            command = [sys.executable, str(ROOT / "benchmarks" / script), *rest]
            done = subprocess.run(command, cwd=folder, env=environment, check=False)
            if done.returncode:
                raise FiguresError(f"{part}: {script} has ended with code {done.returncode}")
        found += map(json.loads, tables.read_text(encoding="utf-8").splitlines())
        if part in PICTURES:
            written, name = PICTURES[part]
            shutil.copy(Path(folder) / "benchmarks" / "results" / written, pictures / name)
    return found


def commit() -> str:
    """The commit of the working copy, with a plus sign where files differ from it."""
    command = ["git", "describe", "--always", "--abbrev=12", "--exclude=*", "--dirty=+"]
    told = subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)
    return told.stdout.strip() or "unknown"


def machine() -> dict[str, Any]:
    """Where and with what the figures were measured."""
    versions = {"python": platform.python_version()}
    for package in PACKAGES:
        try:
            versions[package] = version(package)
        except PackageNotFoundError:
            continue
    return {
        "date": datetime.now(timezone.utc).date().isoformat(),
        "processor": platform.processor() or platform.machine(),
        "cores": os.cpu_count(),
        "system": platform.platform(),
        "versions": versions,
    }


def table_of(known: Mapping[str, Any], name: str) -> list[str]:
    """The Markdown of a table named as in a document's comment, of what was measured by part.

    Raises:
        FiguresError: There is no such table, column or row.
    """
    place, *choices = (word.strip() for word in name.split("|"))
    part, _, title = (word.strip() for word in place.partition(":"))
    matching = [
        one for one in known.get(part, {}).get("tables", ()) if one["title"].startswith(title)
    ]
    if not matching:
        raise FiguresError(f"no table '{place}' has been measured")
    headings, rows = matching[0]["headings"], matching[0]["rows"]
    for choice in choices:
        kind, _, text = choice.partition(":")
        wanted = [word.strip() for word in text.split(",")]
        present = headings if kind == "columns" else [row[0].strip("*`") for row in rows]
        if kind not in ("columns", "rows") or not set(wanted) <= set(present):
            raise FiguresError(f"'{choice}' of table '{place}'; there are: {', '.join(present)}")
        if kind == "columns":
            chosen = [headings.index(one) for one in wanted]
            headings, rows = wanted, [[row[column] for column in chosen] for row in rows]
        else:
            rows = [rows[present.index(one)] for one in wanted]
    return Table(title, headings, rows, matching[0]["names"]).markdown()


def generated(text: str, known: Mapping[str, Any]) -> str:
    """A document with all of its tables written anew."""

    def block(found: re.Match[str]) -> str:
        lines = "\n".join(table_of(known, found[1]))
        return f"<!-- figures {found[1]} -->\n{lines}\n{END}"

    return _BLOCK.sub(block, text)


def documents(known: Mapping[str, Any]) -> Iterator[tuple[Path, str, str]]:
    """Path, text and generated text of each document."""
    for name in DOCUMENTS:
        path = ROOT / name
        text = path.read_text(encoding="utf-8")
        yield path, text, generated(text, known)


def read_figures() -> dict[str, Any]:
    """What was measured: `machine`, and `parts` by name."""
    return json.loads((ROOT / FIGURES).read_text(encoding="utf-8"))


def main(arguments: Sequence[str] | None = None) -> None:
    """Run the command line."""
    parser = options_of.parser(__doc__)
    commands = parser.add_subparsers(dest="command", required=True)
    measuring = commands.add_parser("measure")
    measuring.add_argument("footage", type=Path, metavar="FOLDER")
    measuring.add_argument("--only", action="append", choices=PARTS, help="may be repeated")
    options_of.add_seeds(measuring, 3, "at most")
    measuring.add_argument("--output", type=Path, default=ROOT / FIGURES, help=argparse.SUPPRESS)
    commands.add_parser("write")
    options = parser.parse_args(arguments)
    try:
        if options.command == "measure":
            _measure(options)
            return
        # All of them before any is written, as one may name a table that there is not.
        for path, old, new in list(documents(read_figures()["parts"])):
            if new != old:
                path.write_text(new, encoding="utf-8")
                print(f"{path.relative_to(ROOT)}: written")
    except (FiguresError, OSError) as error:
        parser.error(str(error))


def _measure(options: argparse.Namespace) -> None:
    footage = options.footage.resolve()
    if not footage.is_dir():
        raise FiguresError(f"no folder {options.footage}")
    path = options.output
    known = json.loads(path.read_text(encoding="utf-8")) if path.exists() else {"parts": {}}
    path.parent.mkdir(parents=True, exist_ok=True)
    # All of them first, as they take hours.
    planned = {part: PARTS[part](footage, options.seeds) for part in options.only or PARTS}
    for part, commands in planned.items():
        if not commands:
            _leave_out(part, f"its footage is not in {options.footage}")
        elif part.startswith("targets") and importlib.util.find_spec("trackeval") is None:
            # It brings an OpenCV of its own, which would replace that of the environment.
            _leave_out(part, "pip install --no-deps trackeval")
            planned[part] = []
    for part, commands in planned.items():
        if not commands:
            continue
        known["parts"][part] = {
            "tables": measure(part, commands, path.resolve().parent),
            "commands": [" ".join(one).replace(f"{footage}/", "FOOTAGE/") for one in commands],
            "seeds": options.seeds,
            "commit": commit(),
        }
        known["machine"] = machine()
        # After each part: another one may fail.
        path.write_text(json.dumps(known, indent=1, sort_keys=True) + "\n", encoding="utf-8")


if __name__ == "__main__":
    main()
