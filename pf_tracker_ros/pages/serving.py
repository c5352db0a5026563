"""A web application with the files of a page and access control for every request."""

from __future__ import annotations

from collections.abc import Awaitable, Callable
from pathlib import Path

from aiohttp import web

from pf_tracker_ros.pages.access import HEADERS, Access

_SHARED = Path(__file__).with_name("shared")
_KINDS = {
    ".html": "text/html",
    ".js": "text/javascript",
    ".css": "text/css",
    ".svg": "image/svg+xml",
}
_INDEX = "index.html"


class Site:
    """The web application of a page.

    Attributes:
        application: Takes further routes.
        port: The port that it is served on, 0 before.

    Args:
        access: Access control.
        page: Folder with the files of the page; the shared files are added.
    """

    def __init__(self, access: Access, page: Path) -> None:
        self.port = 0
        self.application = web.Application(middlewares=[self._guard])
        self.application.on_response_prepare.append(_add_headers)
        self._access = access
        for path in sorted([*page.iterdir(), *_SHARED.iterdir()]):
            name = "" if path.name == _INDEX else path.name
            self.application.router.add_get(f"/{name}", _file_handler(path))

    async def serve(self, host: str, port: int) -> web.AppRunner:
        """Start to serve.

        Args:
            host: Address or name to serve on.
            port: To serve on; 0 selects a free one.

        Returns:
            The runner; its `cleanup` stops the server.

        Raises:
            OSError: The address cannot be served on.
        """
        runner = web.AppRunner(self.application, access_log=None, shutdown_timeout=1.0)
        await runner.setup()
        try:
            await web.TCPSite(runner, host, port).start()
        except OSError:
            await runner.cleanup()
            raise
        self.port = runner.addresses[0][1]
        return runner

    def check_origin(self, request: web.Request) -> None:
        """Refuse a request of another origin.

        Raises:
            HTTPForbidden: The request has another origin, or none.
        """
        host = request.headers.get("Host", "")
        if refusal := self._access.origin_refusal(request.headers.get("Origin"), host):
            raise web.HTTPForbidden(text=refusal)

    @web.middleware
    async def _guard(
        self,
        request: web.Request,
        handler: Callable[[web.Request], Awaitable[web.StreamResponse]],
    ) -> web.StreamResponse:
        """Check the host and the token of every request."""
        host = request.headers.get("Host", "")
        if refusal := self._access.host_refusal(host):
            raise web.HTTPForbidden(text=refusal)
        cookie = f"console_{self.port}"
        given = request.query.get("token")
        if given is not None and self._access.token and self._access.admits(given):
            redirect = web.HTTPSeeOther("/")
            redirect.set_cookie(cookie, self._access.token, httponly=True, samesite="Lax")
            raise redirect
        if not self._access.admits(request.cookies.get(cookie)):
            raise web.HTTPUnauthorized(
                text="This page needs an access token: open the link in the log of the console."
            )
        return await handler(request)


def _file_handler(path: Path) -> Callable[[web.Request], Awaitable[web.Response]]:
    content, kind = path.read_bytes(), _KINDS[path.suffix]

    async def handle(request: web.Request) -> web.Response:
        return web.Response(body=content, content_type=kind, charset="utf-8")

    return handle


async def _add_headers(request: web.Request, response: web.StreamResponse) -> None:
    for name, value in HEADERS.items():
        response.headers.setdefault(name, value)
