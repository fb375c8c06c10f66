"""Options that many verbs share."""

from collections.abc import Sequence

import click

set_option = click.option(
    "--set", "overrides", multiple=True, metavar="KEY=VALUE", help="Override a value of the scenario."
)


def set_words(overrides: Sequence[str]) -> list[str]:
    """What ``set_option`` took, as it stands on a command line."""
    return [word for override in overrides for word in ("--set", override)]
