"""A lifecycle node with plain methods as transitions, which logs their failures."""

from __future__ import annotations

import traceback
from collections.abc import Callable
from functools import partial
from typing import Any

from lifecycle_msgs.srv import ChangeState
from rclpy.lifecycle import LifecycleNode, LifecycleState, TransitionCallbackReturn

_LONGEST_TRACEBACK = 5000


class ManagedNode(LifecycleNode):
    """Runs `configure`, `activate`, `deactivate` and `clean_up` as its transitions.

    rclpy ignores exceptions of a transition. Here a ValueError refuses it: the reason is logged,
    and the node keeps its state. Anything else is logged with its traceback, and the node is
    cleaned up.

    Args:
        name: Name of the node.
        **options: Keyword arguments of `rclpy.node.Node`.
    """

    def __init__(self, name: str, **options: Any) -> None:
        super().__init__(name, **options)
        # rclpy raises for an invalid transition, so its client would get no response.
        service = self._service_change_state
        service.callback = partial(self._change_state, service.callback)

    def configure(self) -> None:
        """Create what the node needs."""

    def activate(self) -> None:
        """Start to work."""

    def deactivate(self) -> None:
        """Stop to work."""

    def clean_up(self) -> None:
        """Remove what `configure` and `activate` created; called in any state."""

    def start(self) -> None:
        """Configure and activate the node, as a lifecycle manager would."""
        configured = self.trigger_configure()  # type: ignore[no-untyped-call]
        if configured == TransitionCallbackReturn.SUCCESS:
            self.trigger_activate()  # type: ignore[no-untyped-call]

    @property
    def lifecycle_state(self) -> str:
        """`unconfigured`, `inactive`, `active` or `finalized`, or a transition's name."""
        return str(self._state_machine.current_state[1])

    def on_configure(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: D102
        return self._run(self.configure, undo=self.clean_up)

    def on_activate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: D102
        return self._run(self.activate, undo=self.deactivate)

    def on_deactivate(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: D102
        return self._run(self.deactivate)

    def on_cleanup(self, state: LifecycleState) -> TransitionCallbackReturn:  # noqa: D102
        return self._run(self.clean_up)

    on_shutdown = on_error = on_cleanup

    def _change_state(
        self,
        respond: Callable[[ChangeState.Request, ChangeState.Response], ChangeState.Response],
        request: ChangeState.Request,
        response: ChangeState.Response,
    ) -> ChangeState.Response:
        try:
            return respond(request, response)
        except RuntimeError as error:
            # A shut down context is no failure to log, here and below.
            if self.context.ok():
                logger = self.get_logger()  # type: ignore[no-untyped-call]
                logger.error(f"the state {self.lifecycle_state} has no such transition: {error}")
            response.success = False
            return response

    def _run(self, transition: Callable[[], None], undo: Callable[[], None] = lambda: None) -> Any:
        logger = self.get_logger()  # type: ignore[no-untyped-call]
        try:
            transition()
        except ValueError as error:
            logger.error(f"cannot {transition.__name__.replace('_', ' ')}: {error}")
            undo()
            return TransitionCallbackReturn.FAILURE
        except BaseException:
            # A part of another package may raise what would end the process.
            if self.context.ok():
                # The end of a traceback is its most useful part.
                details = traceback.format_exc()[-_LONGEST_TRACEBACK:]
                logger.error(f"{transition.__name__} failed: {details}")
            return TransitionCallbackReturn.ERROR
        return TransitionCallbackReturn.SUCCESS
