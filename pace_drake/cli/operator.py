"""``pace operator``: a button, pressed from the command line."""

import click

from pace_drake.cli.options import lcm_url_option


@click.command("operator", short_help="Press a button over LCM: request, stop or ack.")
@click.argument("event", type=click.Choice(["request", "stop", "ack"]))
@lcm_url_option
@click.option("--channel", default="PACE_OPERATOR", show_default=True, help="LCM channel of the buttons.")
@click.option("--sender", default="pace operator", show_default=True, help="Who presses it, for logs.")
def command(event: str, url: str, channel: str, sender: str) -> None:
    """Publish one EVENT: 'request' (the person is done, or asks for help), 'stop' or 'ack' (acknowledge).

    A stop holds until it is acknowledged. It is NO emergency stop: a message may be lost.
    """
    import time

    from pace_drake.lcm.config import LcmConfig
    from pace_drake.lcm.types import lcmt_pace_operator
    from pace_drake.lcm.url import open_lcm

    message = lcmt_pace_operator()
    message.utime, message.sender = int(1e6 * time.time()), sender
    message.event = {
        "request": lcmt_pace_operator.REQUEST,
        "stop": lcmt_pace_operator.STOP,
        "ack": lcmt_pace_operator.ACKNOWLEDGE,
    }[event]
    open_lcm(LcmConfig(url=url)).Publish(channel, message.encode())
    click.echo(f"{event} sent on {channel}, {url}")
