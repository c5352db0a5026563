"""Who may use the page: which names it answers to, which pages may talk to it, with which token.

A page of any other origin can make a browser send requests here, and a name that an attacker owns
can be made to lead to this machine. So each request has to name this machine in its `Host`, and
what drives the tracker has to come from a page that was served under that same name.
"""

from __future__ import annotations

import ipaddress
import secrets
import socket
from urllib.parse import urlsplit

CONTENT_SECURITY_POLICY = (
    "default-src 'none'; script-src 'self'; style-src 'self'; img-src 'self'; connect-src 'self'; "
    "base-uri 'none'; form-action 'none'; frame-ancestors 'none'"
)
HEADERS = {
    "Content-Security-Policy": CONTENT_SECURITY_POLICY,
    "X-Content-Type-Options": "nosniff",
    "Referrer-Policy": "no-referrer",
    "Cross-Origin-Resource-Policy": "same-origin",
    "Cross-Origin-Opener-Policy": "same-origin",
    "Cache-Control": "no-store",
}
"""Sent with every answer."""


class Access:
    """Decides on requests by what their headers say.

    Attributes:
        token: That a browser has to bring; empty where only this machine can reach the page.

    Args:
        host: Address or name that the page is served on.
    """

    def __init__(self, host: str) -> None:
        self._is_local = is_loopback(host)
        self.token = "" if self._is_local else secrets.token_urlsafe(24)
        machine = socket.gethostname().lower()
        self._names = {host.lower(), machine, f"{machine.partition('.')[0]}.local"}

    def host_refusal(self, host: str) -> str:
        """Why a request is refused for its `Host` header, or empty.

        Args:
            host: The header, with or without a port.
        """
        name = host_name(host)
        if name and (is_loopback(name) or (not self._is_local and self._is_own(name))):
            return ""
        allowed = "localhost" if self._is_local else "this machine's name or address"
        return f"this page is not served under the name {host!r}; open it by {allowed}"

    def origin_refusal(self, origin: str | None, host: str) -> str:
        """Why a request that could drive the tracker is refused for where it comes from, or empty.

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
        named = origin.encode(errors="backslashreplace").decode() if origin else "unknown origin"
        return f"a page of {named} may not drive this one"

    def admits(self, token: str | None) -> bool:
        """Whether a token, None without one, is the one that is asked for, if any is."""
        if not self.token:
            return True
        given = (token or "").encode(errors="surrogatepass")
        return secrets.compare_digest(given, self.token.encode())

    def _is_own(self, name: str) -> bool:
        # An address cannot be made to lead elsewhere, as a name can.
        return name in self._names or _address(name) is not None


def is_loopback(host: str) -> bool:
    """Whether a name or address without a port is that of the loopback."""
    if host.lower() == "localhost":
        return True
    address = _address(host)
    return address is not None and address.is_loopback


def host_name(host: str) -> str:
    """The name or address in a `Host` header, in lower case; empty if it holds none."""
    try:
        parts = urlsplit(f"//{host}")
        # Raises where the port is none.
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
