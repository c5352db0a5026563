"""Makes rclpy's messages by the names of their types, for `pf_tracker_ros.messages`."""

from __future__ import annotations

from functools import cache
from importlib import import_module
from typing import Any

import numpy as np


def new_message(message_type: str, /, **fields: Any) -> Any:
    """A message; what is left out is 0 or empty.

    Args:
        message_type: As `package/msg/Name`.
        fields: By their names; `data` as an array of octets.

    Raises:
        ModuleNotFoundError: The package is not installed.
    """
    data = fields.pop("data", None)
    if isinstance(level := fields.get("level"), int):
        fields["level"] = bytes([level])
    message = message_class(message_type)(**fields)
    if data is not None:
        # In place: what a message is made with it copies once more, an ndarray one by one.
        message.data.frombytes(np.ascontiguousarray(data).data)
    return message


@cache
def message_class(message_type: str) -> Any:
    """The class of a message by `package/msg/Name`; raises as `new_message`."""
    package, _, name = message_type.partition("/msg/")
    return getattr(import_module(f"{package}.msg"), name)
