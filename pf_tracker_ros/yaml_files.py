"""YAML files that a person writes, read so that no file can do harm."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import check_file


class YamlError(ValueError):
    """A file that cannot be read as YAML."""


def read_yaml(path: Path, what: str) -> Any:
    """The content of a YAML file of plain values.

    An alias is refused, as rcl does: a few lines of them stand for more than any memory holds.

    Args:
        path: The file.
        what: What it should be, for the message, such as `target file`.

    Raises:
        YamlError: It is missing, may not be read, or is no such file.
        ModuleNotFoundError: PyYAML is not installed.
    """
    # Only the commands that read such files need it.
    import yaml

    try:
        check_file(path, what)
        text = path.read_text(encoding="utf-8")
        if any(isinstance(event, yaml.AliasEvent) for event in yaml.parse(text)):
            raise YamlError("aliases, such as *name, are not allowed")
        return yaml.safe_load(text)
    except FootageError as error:
        raise YamlError(str(error)) from error
    except Exception as error:
        # Besides its own errors PyYAML raises many others: of what is nested too deeply, or has a
        # tag that does not suit it.
        reason = " ".join(str(error).split())
        raise YamlError(f"{path} cannot be read as YAML ({reason})") from error
