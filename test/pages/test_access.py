"""Access control by the headers of a request."""

import pytest

from pf_tracker_ros.pages.access import CONTENT_SECURITY_POLICY, Access, host_name

OWN = "127.0.0.1:8642"


@pytest.mark.parametrize("host", ["localhost", "127.0.0.1:8642", "[::1]:9000", "LOCALHOST:1"])
def test_the_loopback_is_admitted_under_its_names_and_any_port(host):
    """A tunnel has another port, such as with `ssh -L 9000:localhost:8642`."""
    assert Access("127.0.0.1").host_refusal(host) == ""


@pytest.mark.parametrize(
    "host",
    [
        "",
        "attacker.example",
        "attacker.example:8642",
        "localhost.attacker.example",
        "127.0.0.1.attacker.example",
        "127.0.0.1@attacker.example",
        "192.168.1.5:8642",
        "localhost:port",
        "[::1",
        "localhost/..",
    ],
)
def test_other_host_names_are_refused(host):
    assert repr(host) in Access("127.0.0.1").host_refusal(host)


def test_beyond_the_loopback_addresses_and_own_names_are_admitted(monkeypatch):
    monkeypatch.setattr("socket.gethostname", lambda: "Robot.example.org")
    access = Access("0.0.0.0")
    for host in ("192.168.1.5:8642", "robot.example.org", "robot.local:8642", "localhost:8642"):
        assert access.host_refusal(host) == ""
    for host in ("attacker.example", "robot.attacker.example", "example.org"):
        assert access.host_refusal(host)


def test_only_the_same_origin_may_control_the_tracker():
    access = Access("127.0.0.1")
    assert access.origin_refusal(f"http://{OWN}", OWN) == ""
    assert access.origin_refusal(f"HTTPS://{OWN}", OWN) == ""
    for origin in (
        None,
        "",
        "null",
        "http://attacker.example",
        "http://127.0.0.1:8643",
        "http://localhost:8642",
        f"http://{OWN}.attacker.example",
        f"file://{OWN}",
        "http://[",
        # Bytes that are not UTF-8.
        "http://\udcff\udcfe",
    ):
        assert b"may not control" in access.origin_refusal(origin, OWN).encode()


@pytest.mark.parametrize("host", ["127.0.0.1", "127.1.2.3", "::1", "localhost"])
def test_the_loopback_needs_no_token(host):
    access = Access(host)
    assert access.token == ""
    assert access.admits(None)


@pytest.mark.parametrize("host", ["0.0.0.0", "::", "192.168.1.5", "robot.local"])
def test_beyond_the_loopback_a_new_token_is_required_each_time(host):
    access = Access(host)
    assert len(access.token) >= 32
    assert access.token != Access(host).token
    assert access.admits(access.token)
    for wrong in (None, "", access.token[:-1], access.token + "x", "ünïcode", "\udcff"):
        assert not access.admits(wrong)


def test_the_policy_allows_no_other_origin_and_nothing_inline():
    rules = dict(rule.split(" ", 1) for rule in CONTENT_SECURITY_POLICY.split("; "))
    assert rules["default-src"] == "'none'"
    assert set(rules.values()) == {"'none'", "'self'"}


def test_a_header_with_more_than_a_host_is_invalid():
    assert host_name("Localhost:80") == "localhost"
    assert host_name("[::1]:80") == "::1"
    for host in ("user@localhost", "localhost:99999999", "localhost?x", "localhost#x"):
        assert host_name(host) == ""
