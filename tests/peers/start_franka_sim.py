"""Starts franka-sim on one address of this machine. Run it in .venv-franka.

    .venv-franka/bin/python tests/peers/start_franka_sim.py 127.0.0.6 .venv-franky

It ends a motion, as the robot does, when 20 commands in a row are late (communication_constraints_violation); with
``--limits`` also when a command breaks the robot's limits.

franka-sim downloads its model; here it gets the one that franky-sim has, from that one's environment. (Its own command
line cannot be told an address, and listens on all of them.)
"""

import argparse
import logging
import os
import signal
import tempfile
from pathlib import Path


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("address")
    parser.add_argument("franky", help="environment that has franky-sim")
    parser.add_argument("--limits", action="store_true")
    arguments = parser.parse_args()
    # As Ctrl-C, so that the folder below is removed.
    signal.signal(signal.SIGTERM, signal.default_int_handler)
    (assets,) = Path(arguments.franky).resolve().glob("lib/python*/site-packages/franky_sim/assets")
    with tempfile.TemporaryDirectory() as folder:
        # franky-sim's file expects a program that says where the meshes are.
        model = Path(folder, "fr3.xml")
        text = (assets / "fr3.xml").read_text()
        assert 'meshdir="assets"' in text
        model.write_text(text.replace('meshdir="assets"', f'meshdir="{assets / "meshes"}"'))
        os.environ["FR3_MJCF"] = str(model)
        from franka_sim import FrankaSimServer

        server = FrankaSimServer(
            host=arguments.address, enforce_comm_constraints=True, enforce_motion_limits=arguments.limits
        )
        try:
            server.start()
        except KeyboardInterrupt:
            server.stop()


if __name__ == "__main__":
    logging.basicConfig(level=logging.INFO)
    main()
