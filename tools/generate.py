"""Generates files from the declared parameters: `config/<preset>.yaml` and `docs/parameters.md`."""

from __future__ import annotations

import argparse
import textwrap
from collections.abc import Iterable, Iterator, Mapping
from pathlib import Path
from typing import Any

from pf_tracker_ros.localization.localizer_parameters import LocalizerParameters
from pf_tracker_ros.node.console.console_parameters import ConsoleParameters
from pf_tracker_ros.node.replay.replay_parameters import ReplayParameters
from pf_tracker_ros.node_parameters import NodeParameters
from pf_tracker_ros.parameter_files import yaml_text
from pf_tracker_ros.parameters import Declaration, declarations
from pf_tracker_ros.tracking.parameters import TrackerParameters
from pf_tracker_ros.tracking.presets import PRESETS, preset_parameters

_COMMAND = "make generate"
_LINE_LENGTH = 100
_INDENT = " " * 4
_NODE = declarations(NodeParameters)
_TRACKER = declarations(TrackerParameters)


def generated_files() -> dict[str, str]:
    """Path in the repository to text, for every generated file."""
    files = {f"config/{preset}.yaml": _preset_file(preset) for preset in PRESETS}
    files["docs/parameters.md"] = _parameter_tables()
    return files


def _preset_file(preset: str) -> str:
    """A ROS parameter file that sets the preset, with its active parameters in comments."""
    values = {name: declaration.default for name, declaration in _NODE.items()}
    values |= preset_parameters(preset)
    lines = [
        f"# Parameters of the tracker node: the preset {preset}. To change a value, copy the file,",
        "# uncomment the parameter, and use the copy with",
        "#   ros2 run pf_tracker_ros tracker --ros-args --params-file FILE",
        "# Parameters without effect in this preset are omitted: see docs/parameters.md.",
        f"# (Written by `{_COMMAND}`.)",
        "/**:",
        "  ros__parameters:",
    ]
    for name, declaration in (_NODE | _TRACKER).items():
        if not declaration.is_active(values):
            continue
        fixed = "fixed while the node runs" if name in _NODE else "a change relearns the target"
        comment = f"{declaration.description} {_allowed(declaration, fixed)}."
        lines += textwrap.wrap(
            comment,
            _LINE_LENGTH,
            initial_indent=f"{_INDENT}# ",
            subsequent_indent=f"{_INDENT}# ",
            break_on_hyphens=False,
        )
        if name == "preset":
            lines.append(f"{_INDENT}{name}: {yaml_text(preset)}")
        else:
            lines.append(f"{_INDENT}#{name}: {yaml_text(values[name])}")
    return "\n".join(lines) + "\n"


def _parameter_tables() -> str:
    presets = {preset: preset_parameters(preset) for preset in PRESETS}
    selectors = dict.fromkeys(one.condition.selector for one in _TRACKER.values() if one.condition)
    sections = [
        "# Parameters",
        f"Written by `{_COMMAND}` from the declarations in the code.",
        "Parameters change at run time by `ros2 param set`, unless they are named as fixed.",
        "## The node `pf_tracker`",
        "With an invalid value at start-up the node runs, but does not track until every such "
        "parameter, even a fixed one, has a valid value. An unknown parameter has no effect.",
        *_node_section(_NODE),
        "## The tracker",
        "The same in the node and in the library (`Tracker.from_preset`, `set_parameters`). The "
        "preset is `default` unless set; other presets are listed where they differ from it. "
        f"A change of {_listed(_read_only(_TRACKER))} makes the tracker learn every target again "
        "where it was last seen.",
        f"{_listed(selectors)} select parts of the tracker. Parameters of a part are used only if "
        "it is selected.",
        "With `max_targets` above 1 the presets have the same values except for "
        f"{_multi_target_differences()}.",
        _table(_TRACKER, presets),
        "## The localizer `localizer`",
        *_node_section(declarations(LocalizerParameters)),
        "## The replay publisher `replay`",
        *_node_section(declarations(ReplayParameters)),
        "## The console `console`",
        *_node_section(declarations(ConsoleParameters)),
    ]
    return "\n\n".join(sections) + "\n"


def _multi_target_differences() -> str:
    """The presets' values that differ for several targets, as a clause."""
    differences = []
    for preset in PRESETS:
        single, multi = preset_parameters(preset), preset_parameters(preset, 2)
        changed = [
            f"`{name}: {yaml_text(value)}`"
            for name, value in multi.items()
            if name != "max_targets" and single[name] != value
        ]
        if changed:
            differences.append(f"`{preset}`, which then has {', '.join(changed)}")
    return " and ".join(differences)


def _listed(names: Iterable[str]) -> str:
    *others, last = (f"`{name}`" for name in names)
    return f"{', '.join(others)} and {last}" if others else last


def _node_section(known: Mapping[str, Declaration]) -> list[str]:
    """The table of a node, after the parameters that cannot change."""
    fixed = _read_only(known)
    return [*([f"Fixed once the node runs: {_listed(fixed)}."] if fixed else []), _table(known)]


def _read_only(known: Mapping[str, Declaration]) -> list[str]:
    return [name for name, declaration in known.items() if declaration.read_only]


def _table(
    known: Mapping[str, Declaration], presets: Mapping[str, Mapping[str, Any]] | None = None
) -> str:
    others = ["other presets"] if presets else []
    rows = [["name", "default", *others, "allowed", "description"]]
    rows.append(["---"] * len(rows[0]))
    for name, declaration in known.items():
        values = {preset: yaml_text(one[name]) for preset, one in (presets or {}).items()}
        default = values.get("default", yaml_text(declaration.default))
        cells = [f"`{name}`", f"`{default}`"]
        if presets:
            differing = (
                f"{preset} `{value}`" for preset, value in values.items() if value != default
            )
            cells.append(", ".join(differing))
        rows.append([*cells, _values(declaration), declaration.description])
    return "\n".join(_row(row) for row in rows)


def _values(declaration: Declaration) -> str:
    """Type, allowed values and unit."""
    choices = ", ".join(f"`{choice}`" for choice in declaration.choices)
    parts = [declaration.type_name, choices or declaration.allowed, declaration.unit]
    if declaration.choices and declaration.type is str:
        parts = [choices]
    return ", ".join(part for part in parts if part and part != "true or false")


def _row(cells: Iterable[str]) -> str:
    return "| " + " | ".join(cell.replace("|", "\\|") for cell in cells) + " |"


def _allowed(declaration: Declaration, fixed: str) -> str:
    unit = f" [{declaration.unit}]" if declaration.unit else ""
    note = f"; {fixed}" if declaration.read_only else ""
    return f"Allowed: {declaration.type_name}, {declaration.allowed}{unit}{note}"


def main(arguments: list[str] | None = None) -> None:
    """Write the generated files and print their paths."""
    parser = argparse.ArgumentParser(description="Write the preset files and their table.")
    parser.add_argument(
        "directory", nargs="?", type=Path, default=Path(), help="the repository [.]"
    )
    directory: Path = parser.parse_args(arguments).directory
    if not (directory / "pf_tracker_ros").is_dir():
        parser.error(f"{directory.resolve()} is not the repository: no folder pf_tracker_ros in it")
    for path in _write(directory):
        print(path)


def _write(directory: Path) -> Iterator[Path]:
    for name, text in generated_files().items():
        path = directory / name
        path.parent.mkdir(exist_ok=True)
        path.write_text(text, encoding="utf-8")
        yield path


if __name__ == "__main__":
    main()
