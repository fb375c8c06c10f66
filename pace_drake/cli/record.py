"""``pace record``: a tracked hand becomes demonstrations."""

import sys
from collections.abc import Sequence
from contextlib import suppress
from math import inf, isfinite
from pathlib import Path
from typing import TYPE_CHECKING

import click

from pace_drake.cli.options import of_a_network
from pace_drake.errors import InputError, require

if TYPE_CHECKING:
    from pace_drake.bridge.hand_recording import HandRecording
    from pace_drake.demos import Demonstration
    from pace_drake.lcm.config import LcmConfig


@click.command("record", short_help="Record a tracked hand as demonstrations, over LCM or from a log.")
@click.argument("file", type=click.Path(path_type=Path, dir_okay=False))
@click.option("--action", required=True, help="Which action is shown, by its name in the scenario.")
@click.option("--subject", required=True, help="Who shows it, such as P1.")
@click.option("--trial", help="Which of their trials; default the first number that is not in FILE.")
@click.option(
    "--lcm-url",
    "url",
    callback=of_a_network,
    help="Where the tracker sends, such as 'udpm://239.255.76.67:7667?ttl=0'.",
)
@click.option("--log", type=click.Path(path_type=Path), help="An LCM log, or a run folder of `pace bridge`, instead.")
@click.option("--from", "start", type=float, default=0.0, help="[s] since the log's first message; default 0.")
@click.option("--to", "end", type=float, default=inf, help="[s] likewise; default the log's end.")
@click.option("--channel", default="PACE_HAND", show_default=True, help="The tracker's (lcmt_pace_hand).")
@click.option("--operator-channel", default="PACE_OPERATOR", show_default=True, help="The buttons'.")
@click.option(
    "--period",
    type=float,
    default=0.1,
    show_default=True,
    help="[s] between samples: human.sample_period.",
)
@click.option("--max-gap", type=float, default=0.2, show_default=True, help="[s] without a sample that is refused.")
def command(
    file: Path,
    action: str,
    subject: str,
    trial: str | None,
    url: str | None,
    log: Path | None,
    start: float,
    end: float,
    channel: str,
    operator_channel: str,
    period: float,
    max_gap: float,
) -> None:
    """Record an ACTION that a tracked person shows, and add it to FILE (.npz, .csv; made if it is not there).

    With --lcm-url, trial after trial: Enter, or the button (REQUEST), when the person begins and when they have
    finished; q and Enter ends. With --log, one trial, cut out of a log by --from and --to.

    FILE can be played (`pace run --hand`) and named in a scenario (human.demonstrations); its folder is what
    `pace tune --data` learns from. Positions as tracked, in world [m] (docs/lcm.md).
    """
    from pace_drake.bridge.hand_recording import recording_of
    from pace_drake.bridge.lcm_log import log_file, read_log
    from pace_drake.lcm.config import LcmConfig

    if (url is None) == (log is None):
        raise InputError("give either --lcm-url, where a tracker sends, or --log, a recorded LCM log")
    for name, value in (("--period", period), ("--max-gap", max_gap)):
        require(isfinite(value) and value > 0, name, f"must be > 0 [s], is {value}")
    require(log is None or 0 <= start < end, "--from, --to", f"0 <= from < to must hold, are {start:g} and {end:g} [s]")
    config = LcmConfig(url=url or "memq://", person_hand_channel=channel, operator_channel=operator_channel)
    book = _Book(file, action, subject, trial, period, max_gap)
    if log is None:
        _record(config, book)
        return
    path = log_file(log)
    messages = list(read_log(path))
    try:
        recording = recording_of(messages, config, start, end)
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    click.echo(book.add(recording))


class _Book:
    """The file, to which trials are added; what is in it stays as it is."""

    def __init__(self, file: Path, action: str, subject: str, trial: str | None, period: float, max_gap: float) -> None:
        from pace_drake.demos import read_demonstrations
        from pace_drake.files import check_file

        self.file, self.action, self.subject = file, action, subject
        self.period, self.max_gap, self.num_added = period, max_gap, 0
        if file.suffix.lower() not in (".npz", ".csv"):
            raise InputError(f"{file}: is neither .npz nor .csv, choose one of them")
        check_file(file)
        self.known: Sequence[Demonstration] = read_demonstrations(file) if file.exists() else ()
        for one in self.known:
            require(
                abs(one.sample_period - period) < 1e-6,
                str(file),
                f"holds samples every {one.sample_period:g} s, not {period:g} s; choose another file, or its --period",
            )
        self.trial = trial or self._next_trial()
        self._check_trial()

    def _taken(self) -> set[str]:
        return {one.trial for one in self.known if (one.action, one.subject) == (self.action, self.subject)}

    def _next_trial(self) -> str:
        taken = self._taken()
        return next(str(k) for k in range(1, len(taken) + 2) if str(k) not in taken)

    def _check_trial(self) -> None:
        if self.trial in self._taken():
            raise InputError(
                f"{self.file}: already holds {self.action}/{self.subject}/{self.trial}; choose another --trial"
            )

    def add(self, recording: "HandRecording") -> str:
        """Adds a trial, and says in one line what it is."""
        from pace_drake.demos import write_demonstrations

        one = recording.demonstration(self.action, self.subject, self.trial, self.period, self.max_gap)
        write_demonstrations(self.file, [*self.known, one])
        self.known, self.num_added = [*self.known, one], self.num_added + 1
        self.trial = self._next_trial()
        return (
            f"{self.file}: {'SYNTHETIC ' * one.synthetic}{one.name}, {one.duration:.1f} s of"
            f" {recording.num_samples} samples; {len(self.known)} demonstrations in it"
        )


def _record(config: "LcmConfig", book: _Book) -> None:
    """Records trial after trial until the operator ends it; one that cannot be used is told, and is shown again."""
    import threading
    from queue import Empty, SimpleQueue

    from pace_drake.bridge.hand_recording import HandRecording
    from pace_drake.lcm.inbox import Inbox
    from pace_drake.lcm.types import lcmt_pace_operator
    from pace_drake.lcm.url import open_lcm

    lcm = open_lcm(config)
    recording: HandRecording | None = None
    lines: SimpleQueue[str] = SimpleQueue()

    def take(data: bytes) -> None:
        if recording is not None:
            recording.take(data)

    def hear_synthetic(data: bytes) -> None:
        if recording is not None:
            recording.synthetic = True

    lcm.Subscribe(config.person_hand_channel, take)
    lcm.Subscribe(config.synthetic_hand_channel, hear_synthetic)
    # A sender may repeat a press against loss: only newer ones count.
    button = Inbox(lcm, config.operator_channel, lcmt_pace_operator)

    def read() -> None:
        for line in sys.stdin:
            lines.put(line.strip())

    def ready() -> None:
        name = f"{book.action}/{book.subject}/{book.trial}"
        click.echo(f"{name}: Enter or the button when the person begins; q and Enter ends")

    threading.Thread(target=read, daemon=True).start()
    ready()
    presses = 0
    try:
        while True:
            lcm.HandleSubscriptions(10)
            line = None
            if button.num_good > presses:
                presses = button.num_good
                line = "" if button.newest.event == lcmt_pace_operator.REQUEST else None
            with suppress(Empty):
                line = lines.get_nowait()
            if line not in ("", "q"):
                continue
            if recording is not None:
                shown, recording = recording, None
                try:
                    click.echo(book.add(shown))
                except InputError as error:
                    click.echo(f"not kept: {error}")
                if line == "":
                    ready()
            elif line == "":
                recording = HandRecording()
                click.echo("recording: Enter or the button when they have finished")
            if line == "q":
                break
    except KeyboardInterrupt:
        under_way = "" if recording is None else ", and not the one that was under way"
        raise KeyboardInterrupt(f"{book.num_added} trials were added to {book.file}{under_way}") from None
    click.echo(f"{book.num_added} trials added to {book.file}")
