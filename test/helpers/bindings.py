"""A node whose parameters are bound to declared ones."""

import nodes
from rclpy.node import Node

from pf_tracker_ros.node.parameter_binding import ParameterBinding

RCLPY_PARAMETERS = ("use_sim_time", "start_type_description_service")


class Bound:
    """A node with a binding, its reports and its applied changes.

    Args:
        context: Of the node.
        values: At start-up, by name.
    """

    def __init__(self, context, values):
        self.node = Node("bound", context=context, parameter_overrides=nodes.overrides(values))
        self.reports, self.applied = [], []
        self.binding = ParameterBinding(self.node, self.reports.append)

    def listen(self, **options):
        """Apply changes from now on; returns itself."""
        self.binding.listen(apply=lambda changes: self.applied.append(dict(changes)), **options)
        return self

    def set(self, values):
        """The result of one atomic request."""
        return self.node.set_parameters_atomically(nodes.overrides(values))

    @property
    def on_node(self):
        """The parameters of the node, without those of rclpy; lists as tuples."""
        names = [name for name in self.node._parameters if name not in RCLPY_PARAMETERS]
        found = {name: self.node.get_parameter(name).value for name in names}
        return {
            name: tuple(value) if isinstance(value, list) else value
            for name, value in found.items()
        }

    def is_as(self, expected):
        """Whether node and binding have exactly these values."""
        return self.on_node == self.binding.values == expected
