"""The progress of tracking and its results, for a page. Needs aiohttp.

The page keeps one request open, an event stream. While it is open, somebody looks at the page.
"""

from __future__ import annotations

import asyncio
import json
import os
import threading
import time
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from urllib.parse import quote

from aiohttp import web

from pf_tracker_ros.overlay import encode_jpeg
from pf_tracker_ros.recordings.tracking import TrackedFrame

RESULTS_POLICY = (
    "default-src 'none'; img-src data:; style-src 'unsafe-inline'; script-src 'unsafe-inline'; "
    "media-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'self'"
)
"""Content security policy of the results: that of the report, shown on this machine's page only."""

# Seconds between events, and until a page that was closed is taken for gone; it may be reloading.
_INTERVAL = 0.1
_GONE_AFTER = 2.0


@dataclass(frozen=True)
class WrittenFiles:
    """The written files.

    Attributes:
        files: The files, at least one.
        report: The one of them to show on the page, or None.
    """

    files: Sequence[Path]
    report: Path | None

    def find(self, name: str) -> Path | None:
        """The file of a name in `names`."""
        return self.names.get(name)

    @property
    def names(self) -> Mapping[str, Path]:
        """Path relative to the common folder, to the file; so links between the files work."""
        common = Path(os.path.commonpath([path.absolute().parent for path in self.files]))
        return {path.absolute().relative_to(common).as_posix(): path for path in self.files}


class Progress:
    """The event stream of the pages that look on."""

    def __init__(self) -> None:
        self._frame_count: int | None = None
        self._tracked: TrackedFrame | None = None
        self._began_at = 0.0
        self._outcome: dict[str, object] | None = None
        self._pages = 0
        self._pages_changed = threading.Condition()
        self._is_stopping = False

    def begin(self, frame_count: int | None) -> None:
        """Take the number of frames; None if it is unknown."""
        self._frame_count, self._began_at = frame_count, time.monotonic()

    def show(self, tracked: TrackedFrame) -> None:
        """Take a frame."""
        self._tracked = tracked

    def finish(self, text: str, results: WrittenFiles) -> None:
        """Take the outcome, and wait until no page looks on.

        Without a report, a page looks on until it has the outcome, two seconds at most.

        Args:
            text: How it went.
            results: The written files.
        """
        addresses = {path: f"/results/{quote(name)}" for name, path in results.names.items()}
        self._outcome = {
            "text": text,
            "files": [[path.name, address] for path, address in addresses.items()],
            "report": addresses[results.report] if results.report else None,
        }
        with self._pages_changed:
            while self._pages_changed.wait_for(lambda: self._pages, _GONE_AFTER):
                # A page with the report may be reloading.
                self._pages_changed.wait_for(
                    lambda: not self._pages, None if results.report else _GONE_AFTER
                )
                if not results.report:
                    break

    def stop(self) -> None:
        """End the streams."""
        self._is_stopping = True

    async def on_request(self, request: web.Request) -> web.StreamResponse:
        """Send events until the page is closed."""
        response = web.StreamResponse(headers={"Content-Type": "text/event-stream"})
        await response.prepare(request)
        self._count_page(1)
        try:
            sent, is_last = "", False
            while not is_last:
                is_last = self._is_stopping
                event = json.dumps(self._event())
                # A comment fails, too, when the page is gone.
                await response.write(f"data: {event}\n\n".encode() if event != sent else b":\n\n")
                sent = event
                await asyncio.sleep(_INTERVAL)
        except ConnectionResetError:
            pass
        finally:
            self._count_page(-1)
        return response

    async def on_picture(self, request: web.Request) -> web.Response:
        """Send the newest frame with its targets."""
        tracked = self._tracked
        if tracked is None or tracked.image is None:
            raise web.HTTPNotFound(text="there is no picture yet")
        loop = asyncio.get_running_loop()
        jpeg = await loop.run_in_executor(None, lambda: encode_jpeg(tracked.draw()))
        return web.Response(body=jpeg, content_type="image/jpeg")

    def _count_page(self, change: int) -> None:
        with self._pages_changed:
            self._pages += change
            self._pages_changed.notify_all()

    def _event(self) -> dict[str, object]:
        if self._outcome:
            return self._outcome
        tracked = self._tracked
        if tracked is None:
            return {"frame": None}
        done = tracked.frame.index + 1
        seconds = max(time.monotonic() - self._began_at, 1e-3)
        estimate = tracked.estimate
        return {
            "frame": tracked.frame.index,
            "frames": self._frame_count,
            "state": tracked.state,
            "confidence": float(estimate.confidence) if estimate else None,
            "targets": len(tracked.targets),
            "rate": done / seconds,
        }
