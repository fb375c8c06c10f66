"""Starts franka-sim with its motion limits enforced, on one address of this machine. Run it in .venv-franka.

    .venv-franka/bin/python tests/peers/start_franka_sim.py 127.0.0.6 .venv-franky

franka-sim downloads its model; here it gets the one that franky-sim has, from that one's environment. (Its own command
line cannot be told an address, and listens on all of them.)
"""

import logging
import os
import sys
import tempfile
from pathlib import Path


def main(address: str, franky: str) -> None:
    (assets,) = Path(franky).resolve().glob("lib/python*/site-packages/franky_sim/assets")
    with tempfile.TemporaryDirectory() as folder:
        # franky-sim's file expects a program that says where the meshes are.
        model = Path(folder, "fr3.xml")
        text = (assets / "fr3.xml").read_text()
        assert 'meshdir="assets"' in text
        model.write_text(text.replace('meshdir="assets"', f'meshdir="{assets / "meshes"}"'))
        os.environ["FR3_MJCF"] = str(model)
        from franka_sim import FrankaSimServer

        server = FrankaSimServer(host=address, enforce_motion_limits=True)
        try:
            server.start()
        except KeyboardInterrupt:
            server.stop()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    main(*sys.argv[1:])
