"""Safe reading of YAML files: plain values only, without aliases."""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pf_tracker_ros.footage import FootageError
from pf_tracker_ros.footage.access import read_file

_MAX_DEPTH = 50
# Bytes of a file, which PyYAML reads in about a minute.
_MAX_BYTES = 10 * 10**6


class YamlError(ValueError):
    """A file that cannot be read as YAML."""


def read_yaml(path: Path, what: str) -> Any:
    """The content of a YAML file of plain values.

    Aliases are refused, as in rcl: a few lines of them can expand beyond any memory.

    Args:
        path: The file.
        what: Kind of file for messages, such as `target file`.

    Raises:
        YamlError: The file is missing, not readable or not such a YAML file.
        ModuleNotFoundError: PyYAML is not installed.
    """
    try:
        return parse_yaml(read_file(path, what, _MAX_BYTES).decode("utf-8"))
    except FootageError as error:
        raise YamlError(str(error)) from error
    except (OSError, ValueError) as error:
        raise YamlError(f"{path} cannot be read as YAML ({error})") from error


def parse_yaml(text: str) -> Any:
    """The content of a YAML document, as for `read_yaml`.

    Raises:
        YamlError: It is not such a document.
        ModuleNotFoundError: PyYAML is not installed.
    """
    # Imported here: only commands that read YAML files need PyYAML.
    import yaml

    try:
        depth = 0
        for event in yaml.parse(text):
            if isinstance(event, yaml.AliasEvent):
                raise YamlError("aliases, such as *name, are not allowed")
            depth += isinstance(event, yaml.CollectionStartEvent)
            depth -= isinstance(event, yaml.CollectionEndEvent)
            # PyYAML takes minutes for some kilobytes of brackets.
            if depth > _MAX_DEPTH:
                raise YamlError(f"lists or mappings are nested more than {_MAX_DEPTH} deep")
        return yaml.safe_load(text)
    except Exception as error:
        # PyYAML also raises other errors, as for an unsuitable tag.
        raise YamlError(" ".join(str(error).split())) from error
