"""Options that many verbs share."""

import json
from collections.abc import Sequence

import click

from pace_drake.errors import InputError

set_option = click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario."
)


def of_a_network(_: click.Context, __: click.Parameter, url: str | None) -> str | None:
    """Refuses memq:// as the value of an option; other processes do not hear it."""
    if url is not None and url.startswith("memq:"):
        raise InputError(
            "--lcm-url: memq:// reaches nobody outside this process: give one of a network, such as"
            " udpm://239.255.76.67:7667?ttl=0"
        )
    return url


lcm_url_option = click.option(
    "--lcm-url",
    "url",
    required=True,
    callback=of_a_network,
    help="LCM URL, such as 'udpm://239.255.76.67:7667?ttl=0' for this machine alone.",
)


def with_values(overrides: Sequence[str], **values: str | float | None) -> tuple[str, ...]:
    """What ``set_option`` took, and values of options of their own behind it; None: not given.

    Args:
        overrides: of the option.
        values: by the key in the scenario, with __ for its dots.
    """
    given = {key.replace("__", "."): value for key, value in values.items() if value is not None}
    return (*overrides, *(f"{key}={json.dumps(value)}" for key, value in given.items()))


def set_words(overrides: Sequence[str]) -> list[str]:
    """What ``set_option`` took, as it stands on a command line."""
    return [word for override in overrides for word in ("--set", override)]
