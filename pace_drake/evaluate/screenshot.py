"""A picture of a run's replay, taken by Chromium without a display."""

import shutil
import subprocess
import tempfile
from pathlib import Path

from pace_drake.errors import InputError
from pace_drake.files import write_whole

_PROGRAMS = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
#: WebGL on the processor, no sandbox (root, containers; the page is our own), and nothing that reaches for a network.
_FLAGS = (
    "--headless=new",
    "--no-sandbox",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-dev-shm-usage",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--enable-logging=stderr",
)
#: [ms] of the page's own clock; it stands still while the recording is loaded, and the page needs a few frames then.
_BUDGET = 5000
#: [s] of wall time after which Chromium is given up.
_PATIENCE = 300


def find_chromium() -> str | None:
    """The program, or None if it is not installed."""
    return next((found for found in map(shutil.which, _PROGRAMS) if found), None)


def open_headless(page: Path, at: float | None, *arguments: str) -> subprocess.CompletedProcess[str]:
    """Opens a replay in Chromium without a display, which ends when the page is ready.

    Args:
        page: a file that ``replay.replay_page`` made.
        at: [s] where the replay stands still; None lets it play.
        arguments: of Chromium, on top.

    Raises:
        InputError: there is no Chromium, or the page did not become ready in it.
    """
    program = find_chromium()
    if program is None:
        raise InputError("a picture of the replay needs Chromium; install it (Debian: apt-get install chromium)")
    address = page.resolve().as_uri() + ("" if at is None else f"#t={at:g}")
    with tempfile.TemporaryDirectory(prefix="pace_drake-chromium-", ignore_cleanup_errors=True) as profile:
        command = [program, *_FLAGS, f"--user-data-dir={profile}", f"--virtual-time-budget={_BUDGET}", *arguments]
        try:
            done = subprocess.run([*command, address], capture_output=True, text=True, timeout=_PATIENCE)
        except subprocess.TimeoutExpired:
            raise InputError(f"{page}: Chromium took more than {_PATIENCE} s; is the machine very busy?") from None
    if done.returncode != 0 or "replay ready" not in done.stderr:
        raise InputError(f"{page}: Chromium does not show it as a replay; is it one, and complete?")
    return done


def screenshot(page: Path, path: Path, at: float, *, width: int = 1280, height: int = 720) -> None:
    """Writes a PNG of a replay.

    Args:
        page: a file that ``replay.replay_page`` made.
        path: the picture.
        at: [s] the moment that it shows.
        width, height: [px] of the picture.

    Raises:
        InputError: see ``open_headless``.
    """

    def take(part: Path) -> None:
        open_headless(page, at, f"--window-size={width},{height}", f"--screenshot={part.resolve()}")

    write_whole(path, take)
