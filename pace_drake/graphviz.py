"""Pictures of Graphviz text, by whichever program is installed."""

import shutil
import subprocess
import sysconfig

from pace_drake.errors import InputError

#: Graphviz itself, and a port of it that pip installs (extra ``diagram``); it lays out likewise, not equally.
_PROGRAMS = ("dot", "graphviz-pure")
_STYLE = ("-Gfontname=Helvetica", "-Nfontname=Helvetica", "-Nfontsize=12", "-Granksep=0.9", "-Earrowsize=0.7")


def find_dot() -> str:
    """A program that draws; one that pip installed is found in an environment that is not activated, too.

    Raises:
        InputError: none is installed.
    """
    scripts = sysconfig.get_path("scripts")
    for name in _PROGRAMS:
        program = shutil.which(name) or shutil.which(name, path=scripts)
        if program is not None:
            return program
    raise InputError(
        "the picture needs Graphviz: pip install 'pace_drake[diagram]', or Debian's apt-get install graphviz; a .dot"
        " file needs none"
    )


def draw_dot(text: str, kind: str) -> bytes:
    """The picture of a graph.

    Args:
        text: in Graphviz's language.
        kind: ``svg`` or ``png``.

    Raises:
        InputError: no program is installed, or it cannot draw the text.
    """
    program = find_dot()
    done = subprocess.run([program, f"-T{kind}", *_STYLE], input=text.encode(), capture_output=True)
    if done.returncode != 0:
        raise InputError(f"{program}: {done.stderr.decode(errors='replace').strip()}")
    return done.stdout
