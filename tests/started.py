"""A process that is gone when its block ends, whatever happened in it."""

import contextlib
import subprocess
from collections.abc import Iterator
from typing import Any


@contextlib.contextmanager
def started(command: list[str], **options: Any) -> Iterator[subprocess.Popen]:
    """As ``subprocess.Popen``, which alone would wait for ever for a process that a failed test has left running."""
    with subprocess.Popen(command, **options) as process:
        try:
            yield process
        finally:
            process.kill()
