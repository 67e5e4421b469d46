"""A stand-in for Haply's Inverse Service: its JSON over a WebSocket, one state for each message, faults on request."""

import json
import threading
import time

import websockets.sync.server
from websockets.exceptions import ConnectionClosed


class InverseService:
    """Listens on a free port of this machine until closed.

    target: m, where the hand goes, at most half a millimetre a message. pushes: N, the force's length in each message,
    in order. fault: what it does instead of answering; since: how many messages had come when that was asked.
    """

    def __init__(self):
        self.target, self.position = [0.0, 0.0, 0.01], [0.0, 0.0, 0.01]
        self.pushes, self.forces, self.sessions = [], [], []
        self.buttons, self.bounces = False, 0
        self.fault, self.since, self.closed = None, 0, 0
        self.server = websockets.sync.server.serve(self._serve, "127.0.0.1", 0, compression=None)
        self.port = self.server.socket.getsockname()[1]
        self.thread = threading.Thread(target=self.server.serve_forever, daemon=True)
        self.thread.start()

    def fail(self, fault):
        self.since, self.fault = len(self.pushes), fault

    def pushes_since_fault(self):
        return self.pushes[self.since :]

    def close(self):
        self.server.shutdown()
        self.thread.join()

    def _devices(self, whole):
        if self.fault == "unplugged":
            return []
        x, y, z = self.position
        state = {"cursor_position": {"x": x, "y": y, "z": z}, "cursor_velocity": {"x": 0, "y": 0, "z": 0}}
        device = {"device_id": "049D", "state": state}
        if whole:
            info = {"major_version": 7, "minor_version": 4, "id": "049D"}
            device["config"] = {"type": "inverse3", "device_info": info, "preset": 'a "quoted" {name'}
        return [device]

    def _message(self, whole=False):
        grip = {"device_id": "61576", "state": {"buttons": {"a": self.buttons, "b": False, "c": False}}}
        message = {"inverse3": self._devices(whole), "wireless_verse_grip": [grip]}
        return json.dumps({"session_id": 7, **message} if whole else message)

    def _serve(self, socket):
        try:
            if self.fault == "silent":
                return time.sleep(1.5)
            socket.send('{"version": "2.0"}' if self.fault == "old" else self._message(whole=True))
            for text in socket:
                self._take(json.loads(text))
                if not self._failed(socket):
                    socket.send(self._message())
        except ConnectionClosed:
            pass
        finally:
            self.closed += 1

    def _take(self, message):
        vector = message["inverse3"][0]["commands"]["set_cursor_force"]["vector"]
        assert message["inverse3"][0]["device_id"] == "049D"
        self.forces.append((vector["x"], vector["y"], vector["z"]))
        self.pushes.append(sum(f * f for f in self.forces[-1]) ** 0.5)
        if "session" in message:
            self.sessions.append(message["session"]["configure"]["profile"]["name"])
        step = [max(-5e-4, min(5e-4, t - p)) for t, p in zip(self.target, self.position, strict=True)]
        self.position = [p + s for p, s in zip(self.position, step, strict=True)]
        if self.bounces:
            self.buttons, self.bounces = not self.buttons, self.bounces - 1

    def _failed(self, socket):
        """Whether it answered otherwise, or not at all."""
        if self.fault in (None, "unplugged"):
            return False
        if self.fault == "hang up":
            socket.close()
        elif self.fault == "garbage":
            socket.send(self._message()[:-20])
        elif self.fault == "absurd":
            socket.send(self._message().replace('"x": ', '"x": 1e9'))
        elif self.fault == "no number":
            socket.send(self._message().replace('"x": ', '"x": "a'))
        elif self.fault == "endless":
            socket.send("x" * 300_000)
        elif self.fault == "in pieces":  # allowed: fragments, and a ping between
            text = self._message()
            socket.ping()
            socket.send([text[:7], text[7:30], text[30:]])
        return True  # "stall": nothing
