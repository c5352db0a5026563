"""Creates rclpy messages by type name, for `pf_tracker_ros.messages`."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np


def new_message(message_type: str, /, **fields: Any) -> Any:
    """A message; omitted fields are 0 or empty.

    Args:
        message_type: As `package/msg/Name`.
        **fields: By name; `data` as an array of bytes.

    Raises:
        ModuleNotFoundError: The package is not installed.
    """
    data = fields.pop("data", None)
    if isinstance(level := fields.get("level"), int):
        fields["level"] = bytes([level])
    message = message_class(message_type)(**fields)
    if data is not None:
        # In place: the constructor copies, an ndarray element by element.
        message.data.frombytes(np.ascontiguousarray(data).data)
    return message


@cache
def message_class(message_type: str) -> Any:
    """The class of a message type `package/msg/Name`; raises as `new_message`."""
    package, _, name = message_type.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), name)
