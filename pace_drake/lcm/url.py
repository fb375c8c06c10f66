"""Opens an LCM URL, or says in one line why it cannot be used.

``DrakeLcm`` falls back silently to ``memq://`` when a ``udpm://`` or ``tcpq://`` URL is unavailable, and
still reports the URL it was asked for. ``lcm.LCM(url)`` raises in the same case, so it goes first, as a
preflight.
"""

import warnings
from urllib.parse import parse_qs, urlsplit

from pydrake.lcm import DrakeLcm

from pace_drake.errors import InputError
from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.link import Lcm, LcmNetwork

_SCHEMES = ("memq", "udpm", "tcpq")


def preflight(url: str) -> None:
    """Raises unless LCM can be reached at `url`; warns when its messages may leave this machine.

    ``memq://`` lives inside the process and needs no preflight.

    Args:
        url: LCM URL, such as ``udpm://239.255.76.67:7667?ttl=0``.

    Raises:
        InputError: the scheme is unknown, the Python package ``lcm`` is absent, or the URL cannot be opened.
    """
    scheme, separator, _ = url.partition("://")
    if not separator or scheme not in _SCHEMES:
        raise InputError(f"LCM URL {url!r} must begin with {', '.join(s + '://' for s in _SCHEMES)}")
    if scheme == "memq":
        return
    if scheme == "udpm" and parse_qs(urlsplit(url).query).get("ttl") != ["0"]:
        warnings.warn(
            f"LCM URL {url!r} has no ttl=0: commands may leave this machine and move a robot elsewhere",
            stacklevel=3,
        )
    try:
        # Not `import lcm`: a bare folder named lcm on the path would satisfy that.
        from lcm import LCM
    except ImportError:
        raise InputError(f"LCM URL {url!r} needs the Python package lcm: pip install 'lcm>=1.5'") from None
    try:
        LCM(url)
    except RuntimeError as error:
        raise InputError(
            f"LCM URL {url!r} cannot be opened: check its address; for udpm on loopback run "
            "`ip link set lo up multicast on` and `ip route add 224.0.0.0/4 dev lo`"
        ) from error


def open_lcm(config: LcmConfig) -> Lcm:
    """Opens ``config.url`` after the preflight: a DrakeLcm on ``memq://``, otherwise an LcmNetwork.

    Raises:
        InputError: see `preflight`; also where ``DRAKE_ALLOW_NETWORK`` forbids the URL.
    """
    preflight(config.url)
    try:
        # Drake's word on whether the network may be used counts, whoever uses it.
        lcm = DrakeLcm(config.url)
    except RuntimeError as error:
        raise InputError(f"Drake refuses LCM URL {config.url!r}: {error}") from error
    return lcm if config.url.startswith("memq") else LcmNetwork(config.url)
