"""Access control of the web pages, against cross-site requests and DNS rebinding.

1. The header `Host` of each request has to name this machine. This stops DNS rebinding, where an
   attacker's name resolves to this machine's address.
2. A request that controls the tracker needs the header `Origin` of a page served under the same
   name. This stops requests from pages of other sites in the same browser.
3. Beyond the loopback, each request needs the access token.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
from urllib.parse import urlsplit

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "frame-src 'self'; base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": CONTENT_SECURITY_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Sent with every response."""


class Access:
    """Decides on requests by their headers.

    Attributes:
        token: The required access token; empty if only this machine can reach the page.

    Args:
        host: Address or name that the page is served on.
    """

    def __init__(self, host: str) -> None:
        self._is_local = is_loopback(host)
        self.token = "" if self._is_local else secrets.token_urlsafe(24)
        machine = socket.gethostname().lower()
        self._names = {host.lower(), machine, f"{machine.partition('.')[0]}.local"}

    def host_refusal(self, host: str) -> str:
        """The reason to refuse a request for its `Host` header, or empty.

        Args:
            host: The header, with or without a port.
        """
        name = host_name(host)
        if name and (is_loopback(name) or (not self._is_local and self._is_own(name))):
            return ""
        allowed = "localhost" if self._is_local else "this machine's name or address"
        return f"this page is not served under the name {host!r}; open it by {allowed}"

    def origin_refusal(self, origin: str | None, host: str) -> str:
        """The reason to refuse a controlling request for its `Origin` header, or empty.

        Args:
            origin: The header `Origin`, None without one.
            host: The header `Host`.
        """
        if origin:
            try:
                parts = urlsplit(origin)
            except ValueError:
                parts = urlsplit("")
            if parts.scheme in ("http", "https") and parts.netloc.lower() == host.lower():
                return ""
        name = origin.encode(errors="backslashreplace").decode() if origin else "unknown origin"
        return f"a page of {name} may not control this one"

    def admits(self, token: str | None) -> bool:
        """Whether a token is valid, or none is required."""
        if not self.token:
            return True
        given = (token or "").encode(errors="surrogatepass")
        return secrets.compare_digest(given, self.token.encode())

    def _is_own(self, name: str) -> bool:
        # Any address is safe: DNS rebinding needs a name.
        return name in self._names or _address(name) is not None


def is_loopback(host: str) -> bool:
    """Whether a name or address, without a port, is of the loopback."""
    if host.lower() == "localhost":
        return True
    address = _address(host)
    return address is not None and address.is_loopback


def host_name(host: str) -> str:
    """The name or address in a `Host` header, in lower case; empty if the header is invalid."""
    try:
        parts = urlsplit(f"//{host}")
        # Raises for an invalid port.
        _ = parts.port
    except ValueError:
        return ""
    if parts.username is not None or parts.path or parts.query or parts.fragment:
        return ""
    return parts.hostname or ""


def _address(name: str) -> ipaddress.IPv4Address | ipaddress.IPv6Address | None:
    try:
        return ipaddress.ip_address(name)
    except ValueError:
        return None
