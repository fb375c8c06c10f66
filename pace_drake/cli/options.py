"""Options that many verbs share."""

from collections.abc import Sequence

import click

set_option = click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario."
)

lcm_url_option = click.option(
    "--lcm-url", "url", required=True, help="LCM URL, such as 'udpm://239.255.76.67:7667?ttl=0' for this machine alone."
)


def set_words(overrides: Sequence[str]) -> list[str]:
    """What ``set_option`` took, as it stands on a command line."""
    return [word for override in overrides for word in ("--set", override)]
