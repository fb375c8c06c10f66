"""Runs plain SCXML in Qt, in a process of its own: PySide6 6.12 loses count of None and aborts Python at its exit.

Reads lines of JSON: first {"scxml": text, "names": data}, then the data of one event each; answers each event with the
active states and the values of the data.
"""

import json
import os
import sys

from PySide6.QtCore import QBuffer, QCoreApplication, QIODevice
from PySide6.QtScxml import QScxmlStateMachine


def main() -> None:
    app = QCoreApplication([])
    document = json.loads(sys.stdin.readline())
    buffer = QBuffer()
    buffer.setData(document["scxml"].encode())
    buffer.open(QIODevice.OpenModeFlag.ReadOnly)
    machine = QScxmlStateMachine.fromData(buffer)
    assert not machine.parseErrors(), machine.parseErrors()
    machine.start()
    app.processEvents()
    for line in sys.stdin:
        machine.submitEvent("react", json.loads(line))
        app.processEvents()
        values = {name: machine.dataModel().scxmlProperty(name) for name in document["names"]}
        print(json.dumps({"active": machine.activeStateNames(False), "values": values}), flush=True)


if __name__ == "__main__":
    main()
    sys.stdout.flush()
    os._exit(0)
