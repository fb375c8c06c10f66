"""The one place where tests get an LCM URL of a network: it never leaves this machine."""

import socket
import time


def own_url() -> str:
    """Returns a URL with a port that nobody else uses, and no hop beyond this machine."""
    with socket.socket(socket.AF_INET, socket.SOCK_DGRAM) as probe:
        probe.bind(("", 0))
        port = probe.getsockname()[1]
    return f"udpm://239.255.76.67:{port}?ttl=0"


def why_not(url: str) -> str:
    """Returns why LCM does not work at the URL; empty if it does."""
    try:
        from lcm import LCM
    except ImportError:
        return "the package lcm is absent: pip install 'pace_drake[driver]'"
    try:
        lcm = LCM(url)
    except RuntimeError:
        return "no multicast here: ip link set lo up multicast on; ip route add 224.0.0.0/4 dev lo"
    heard: list[bytes] = []
    lcm.subscribe("PROBE", lambda _, data: heard.append(data))
    end = time.monotonic() + 2.0
    while not heard and time.monotonic() < end:
        lcm.publish("PROBE", b"1")
        lcm.handle_timeout(100)
    return "" if heard else "multicast does not come back to this machine"
