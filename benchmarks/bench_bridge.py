"""How soon a status is answered by a command: ``python benchmarks/bench_bridge.py [seconds]``.

A process of its own stands for the robot: it publishes 200 status messages a second over LCM, on this machine alone,
and notes when commands arrive. It is OURS and no robot. This process answers: first with the least that can be, the
same command at once for each status, then with ``pace bridge``'s session while a collaboration runs. A status is
answered if a command arrives before the next one is sent. Ratios are to the first row, measured in one run.
"""

import json
import multiprocessing as mp
import sys
import time
from collections.abc import Callable

import numpy as np
from drake import lcmt_panda_command, lcmt_panda_status
from rich.console import Console
from rich.table import Table

from pace_drake.lcm.config import LcmConfig
from pace_drake.lcm.panda_peer import PandaPeer
from pace_drake.lcm.url import open_lcm
from pace_drake.scenario import load_scenario

URL = "udpm://239.255.76.67:7688?ttl=0"
STATUS_RATE = 200.0  # [Hz]
WARM_UP = 3.0  # [s] left out of the figures


def robot(home: list[float], result: "mp.Queue[str]", stop: "mp.synchronize.Event") -> None:
    """Publishes status, takes commands, and reports when each came."""
    lcm = open_lcm(LcmConfig(url=URL))
    commands: list[float] = []
    lcm.Subscribe("PANDA_COMMAND", lambda _: commands.append(time.monotonic()))
    peer = PandaPeer(lcm, np.array(home), status_rate=STATUS_RATE, start_utime=round(1e6 * time.time()))
    begin, statuses = time.monotonic(), []
    while not stop.is_set():
        lcm.HandleSubscriptions(1)
        due = len(statuses) / STATUS_RATE
        if time.monotonic() - begin >= due:
            statuses.append(time.monotonic())
            peer.step(due - peer.elapsed())
    result.put(json.dumps([statuses, commands]))


def figures(statuses: list[float], commands: list[float]) -> tuple[float, np.ndarray]:
    """Share of status answered, and the times [s] that the answers took; from the first command on."""
    sent, got = np.array(statuses), np.array(commands)
    first = int(np.searchsorted(sent, got[0] + WARM_UP))
    sent = sent[first:]
    following = np.searchsorted(got, sent[:-1])
    answered = (following < len(got)) & (got[np.minimum(following, len(got) - 1)] < sent[1:])
    return float(np.mean(answered)), got[following[answered]] - sent[:-1][answered]


def measure(home: np.ndarray, answer: Callable[[float], None], duration: float) -> tuple[float, np.ndarray]:
    """Runs the robot beside ``answer(duration)``."""
    context = mp.get_context("spawn")
    result, stop = context.Queue(), context.Event()
    process = context.Process(target=robot, args=(home.tolist(), result, stop))
    process.start()
    answer(duration)
    stop.set()
    statuses, commands = json.loads(result.get())
    process.join()
    return figures(statuses, commands)


def echo(home: np.ndarray) -> Callable[[float], None]:
    """The least that answers."""

    def answer(duration: float) -> None:
        lcm = open_lcm(LcmConfig(url=URL))
        command = lcmt_panda_command()
        command.num_joint_position, command.joint_position = 7, home.tolist()
        command.control_mode_expected = lcmt_panda_status.CONTROL_MODE_POSITION

        def reply(data: bytes) -> None:
            lcmt_panda_status.decode(data)
            command.utime = round(1e6 * time.time())
            lcm.Publish("PANDA_COMMAND", command.encode())

        lcm.Subscribe("PANDA_STATUS", reply)
        end = time.monotonic() + duration
        while time.monotonic() < end:
            lcm.HandleSubscriptions(10)

    return answer


def main() -> None:
    """Both, and a table."""
    duration = float(sys.argv[1]) if len(sys.argv) > 1 else 30.0
    import gc

    from pace_drake.bridge.session import Session
    from pace_drake.lcm.types import lcmt_pace_operator
    from pace_drake.policies.factory import make_policy

    scenario = load_scenario("ikea_chair", (f"lcm.url='{URL}'", "safety.grasp_check=false"))  # the peer holds nothing
    session = Session(scenario, make_policy("learned", scenario), open_lcm(scenario.lcm))
    home = np.array(
        session.simulation.assembly.robot_action.GetOutputPort("position").Eval(
            session.assembly.robot_action.GetMyContextFromRoot(session.simulation.context)
        )
    )
    busy = 0.0

    def bridge(duration: float) -> None:
        nonlocal busy
        gc.collect()
        gc.freeze()
        session.connect(20.0)
        while session.time < 1.0:
            session.step()
        session.begin(session.simulation.sample_episode(np.random.default_rng(0)))
        session.press(lcmt_pace_operator.ACKNOWLEDGE)
        end, began, used = time.monotonic() + duration, time.monotonic(), time.process_time()
        while time.monotonic() < end:
            session.step()
        busy = (time.process_time() - used) / (time.monotonic() - began)

    table = Table("", "status answered", "median [ms]", "p99 [ms]", "ratio of medians")
    reference = None
    for name, answer in (("a command sent back at once", echo(home)), ("pace bridge", bridge)):
        share, times = measure(home, answer, duration)
        median, p99 = 1e3 * np.median(times), 1e3 * np.percentile(times, 99)
        reference = reference or median
        table.add_row(name, f"{100 * share:.2f} %", f"{median:.2f}", f"{p99:.2f}", f"{median / reference:.1f}")
    console = Console()
    console.print(table)
    console.print(
        f"{duration:g} s each; the bridge was busy for {100 * busy:.0f} % of its time, and left out "
        f"{1e3 * session.loop.stalled:.0f} ms that this computer kept it from running; state {session.leaf}"
    )


if __name__ == "__main__":
    main()
