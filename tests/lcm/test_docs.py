"""The sender in docs/lcm.md runs as it stands, and what the page says of channels is true."""

import re
import sys
import types
from dataclasses import fields
from pathlib import Path

from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.types import lcmt_pace_hand

PAGE = (Path(__file__).resolve().parents[2] / "docs" / "lcm.md").read_text()


def test_a_tracker_of_ones_own(monkeypatch):
    sent = []

    class StandIn:
        def __init__(self, url):
            assert url.endswith("?ttl=0")

        def publish(self, channel, data):
            sent.append((channel, lcmt_pace_hand.decode(data)))

    module = types.ModuleType("lcm")
    module.LCM = StandIn
    monkeypatch.setitem(sys.modules, "lcm", module)
    (block,) = re.findall(r"```python\n(.*?)```", PAGE, flags=re.DOTALL)
    exec(block, {"tracker": [[0.5, 0.0, 0.25], [0.5, 0.1, 0.25]]})
    assert [(channel, sample.sequence, sample.p_WH) for channel, sample in sent] == [
        ("PACE_HAND", 0, (0.5, 0.0, 0.25)),
        ("PACE_HAND", 1, (0.5, 0.1, 0.25)),
    ]


def test_every_channel_is_in_the_table():
    config = LcmConfig()
    channels = {field.name: getattr(config, field.name) for field in fields(config) if field.name.endswith("_channel")}
    assert {name: channel for channel, name in re.findall(r"^\| `(\w+)` \(`(\w+)`\)", PAGE, re.MULTILINE)} == channels
