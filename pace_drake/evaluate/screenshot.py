"""A picture of a run's replay, taken by Chromium without a display."""

import base64
import json
import os
import select
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

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
    "--remote-debugging-pipe",
)
#: Chromium reads its orders from file 3 and answers on file 4.
_LAUNCH = """
import fcntl, os, sys
ends = [fcntl.fcntl(int(end), fcntl.F_DUPFD, 10) for end in sys.argv[1:3]]
os.dup2(ends[0], 3)
os.dup2(ends[1], 4)
os.execv(sys.argv[3], sys.argv[3:])
"""
#: [s] of wall time after which Chromium is given up.
_PATIENCE = 240.0
_SETTLED = """new Promise(done => {
  const settle = () => {
    if (document.readyState !== "complete") setTimeout(settle, 50);
    else if (!document.getElementById("pace-story")) done(false);
    else if (document.body.dataset.replay !== "ready") setTimeout(settle, 50);
    else requestAnimationFrame(() => requestAnimationFrame(() => done(true)));
  };
  settle();
})"""


def find_chromium() -> str | None:
    """The program, or None if it is not installed."""
    return next((found for found in map(shutil.which, _PROGRAMS) if found), None)


class HeadlessReplay:
    """A replay that stands still in a Chromium without a display; ``open_headless`` makes it.

    Args:
        page: names the file in messages.
        orders, answers: file descriptors of Chromium's DevTools protocol, one JSON text each, ended by a zero byte.
        width, height: [px] of the window.

    Raises:
        InputError: Chromium does not answer, or does not show a replay.
    """

    def __init__(self, page: Path, orders: int, answers: int, width: int, height: int) -> None:
        self._page, self._orders, self._answers = page, orders, answers
        self._deadline = time.monotonic() + _PATIENCE
        self._received = b""
        self._number = 0
        self._session: dict[str, str] = {}
        targets = self._call("Target.getTargets")["targetInfos"]
        target = next(one["targetId"] for one in targets if one["type"] == "page")
        attached = self._call("Target.attachToTarget", targetId=target, flatten=True)
        self._session = {"sessionId": attached["sessionId"]}
        size = {"width": width, "height": height, "deviceScaleFactor": 1, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", **size)

    def go_to(self, at: float) -> None:
        """Shows the moment ``at`` [s]."""
        address = f"{self._page.resolve().as_uri()}#t={at:g}"
        self._call("Page.navigate", url=address)
        if self.evaluate(_SETTLED) is not True:
            raise InputError(f"{self._page}: is not a replay that pace run wrote")

    def evaluate(self, script: str) -> Any:
        """The value of a JavaScript expression in the page, or what its promise comes to."""
        found = self._call("Runtime.evaluate", expression=script, awaitPromise=True, returnByValue=True)
        return found["result"].get("value")

    def picture(self) -> bytes:
        """PNG of the window."""
        return base64.b64decode(self._call("Page.captureScreenshot", format="png")["data"])

    def _call(self, method: str, **parameters: Any) -> dict[str, Any]:
        self._number += 1
        order = {"id": self._number, "method": method, "params": parameters, **self._session}
        try:
            os.write(self._orders, json.dumps(order).encode() + b"\0")
            while True:
                answer = self._receive()
                if answer.get("id") == self._number and "result" in answer:
                    return answer["result"]
                if answer.get("id") == self._number:
                    raise InputError(f"{self._page}: Chromium refuses {method}: {answer.get('error')}")
        except OSError as error:
            raise InputError(f"{self._page}: Chromium ended ({error.strerror}); does it run here at all?") from error

    def _receive(self) -> dict[str, Any]:
        while b"\0" not in self._received:
            ready, _, _ = select.select([self._answers], [], [], max(self._deadline - time.monotonic(), 0.0))
            if not ready:
                raise InputError(f"{self._page}: Chromium took more than {_PATIENCE:g} s; is the machine very busy?")
            more = os.read(self._answers, 1 << 20)
            if not more:
                raise InputError(f"{self._page}: Chromium ended; does it run here at all?")
            self._received += more
        text, _, self._received = self._received.partition(b"\0")
        return json.loads(text)


@contextmanager
def open_headless(page: Path, *, width: int = 1280, height: int = 720) -> Iterator[HeadlessReplay]:
    """Opens Chromium without a display, for a replay.

    Args:
        page: a file that ``replay.replay_page`` made.
        width, height: [px] of the window.

    Raises:
        InputError: there is no Chromium, or it does not answer.
    """
    program = find_chromium()
    if program is None:
        raise InputError("a picture of the replay needs Chromium; install it (Debian: apt-get install chromium)")
    theirs_in, orders = os.pipe()
    answers, theirs_out = os.pipe()
    with tempfile.TemporaryDirectory(prefix="pace_drake-chromium-", ignore_cleanup_errors=True) as profile:
        command = [sys.executable, "-c", _LAUNCH, str(theirs_in), str(theirs_out), program, *_FLAGS]
        process = subprocess.Popen(
            [*command, f"--user-data-dir={profile}", "about:blank"],
            pass_fds=(theirs_in, theirs_out),
            stdout=subprocess.DEVNULL,
            stderr=subprocess.DEVNULL,
        )
        os.close(theirs_in)
        os.close(theirs_out)
        try:
            yield HeadlessReplay(page, orders, answers, width, height)
        finally:
            # It ends when nobody orders any more.
            os.close(orders)
            os.close(answers)
            try:
                process.wait(10)
            except subprocess.TimeoutExpired:
                process.kill()
                process.wait()


def screenshot(page: Path, path: Path, at: float, *, width: int = 1280, height: int = 720) -> None:
    """Writes a PNG of a replay.

    Args:
        page: a file that ``replay.replay_page`` made.
        path: the picture.
        at: [s] the moment that it shows.
        width, height: [px] of the picture.

    Raises:
        InputError: there is no Chromium, or it does not show the page as a replay.
    """
    with open_headless(page, width=width, height=height) as replay:
        replay.go_to(at)
        picture = replay.picture()
    write_whole(path, lambda part: part.write_bytes(picture))
