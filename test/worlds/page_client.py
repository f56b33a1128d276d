"""A browser's side of a viser page, without a browser: what it shows by label, clicks, its local storage."""

import threading
import time

WAIT_S = 10.0
RECORDER = """
import pathlib, signal, sys, time
bag = pathlib.Path(sys.argv[1]); partial = bag.with_name(bag.name + '.partial')
partial.mkdir(); (partial / 'a.mcap').write_bytes(b'0' * 2000000)

def end(*_):
    partial.rename(bag)
    sys.exit(print('[INFO] [1.5] [bag_recorder]: 82 messages'))

signal.signal(signal.SIGINT, end)
print('ready', flush=True)
time.sleep(60)
"""
"""Stands for the recorder: `python -c RECORDER BAG`, ended by SIGINT."""


class PageClient:
    """One connection, by the link that was printed."""

    def __init__(self, link):
        import msgspec
        import viser
        import zstandard
        from websockets.sync.client import connect

        self._codec, self._zstd = msgspec.msgpack, zstandard.ZstdDecompressor()
        self.parts, self.is_silent = {}, False  # shown, by uuid; silent: it answers nothing any more
        self.error = None  # what a browser says that keeps nothing
        self.camera = ()  # where the map is looked at from
        url, protocols = link.replace("http:", "ws:"), [f"viser-v{viser.__version__}"]
        origin = link.rpartition("/")[0]
        self._socket = connect(url, subprotocols=protocols, origin=origin, max_size=None, open_timeout=WAIT_S)
        self._thread = threading.Thread(target=self._listen, daemon=True)
        self._thread.start()
        lens = {"fov": 1.0, "near": 0.01, "far": 1000.0, "image_height": 600, "image_width": 800}
        pose = {"wxyz": (1, 0, 0, 0), "position": (0, 0, 9), "look_at": (0, 0, 0), "up_direction": (0, 0, 1)}
        self._send("ViewerCameraMessage", **lens, **pose)  # a browser counts from then on

    def _listen(self):
        from websockets.exceptions import ConnectionClosed

        try:
            for frame in self._socket:
                size = int.from_bytes(frame[8:16], "little")
                for message in self._codec.decode(self._zstd.decompress(frame[16 : 16 + size]))["messages"]:
                    self._take(message)
        except ConnectionClosed:
            pass

    def _take(self, message):
        kind = message["type"]
        if kind == "LocalStorageGetItemRequestMessage" and not self.is_silent:
            uuid = message["request_uuid"]
            self._send("LocalStorageGetItemResponseMessage", request_uuid=uuid, value=None, error=self.error)
        elif kind == "SetCameraPositionMessage":
            self.camera = tuple(message["position"])
        elif kind == "GuiRemoveMessage":
            self.parts.pop(message["uuid"], None)
        elif kind == "GuiUpdateMessage":
            self.parts.setdefault(message["uuid"], {}).update(message["updates"])
        elif kind.startswith("Gui") and "props" in message:
            self.parts[message["uuid"]] = dict(message["props"]) | {"kind": kind}

    def _send(self, kind, **fields):
        self._socket.send(self._codec.encode({"type": kind, **fields}))

    def find(self, label):
        """Return the uuid of what has this label; None while nothing has."""
        return next((uuid for uuid, part in list(self.parts.items()) if part.get("label") == label), None)

    def text(self):
        """Return what can be read."""
        fields = ("label", "content", "_markdown")
        shown = (str(part[field]) for part in list(self.parts.values()) for field in fields if field in part)
        return "\n".join(("", *shown, ""))

    def wait_for(self, words):
        """Wait until something can be read."""
        end = time.monotonic() + WAIT_S
        while words not in self.text():
            assert time.monotonic() < end, f"waited for {words!r} in vain, found {self.text()}"
            time.sleep(0.02)

    def set(self, label, value):
        """Change a value, or click a button (True)."""
        self.wait_for(f"\n{label}\n")
        self.forge(self.find(label), value)

    def click(self, label, told=""):
        """Click a button, and wait until something can be read."""
        self.set(label, True)
        self.wait_for(told)

    def hold(self, label):
        """Say once that a button is held."""
        uuid = self.find(label)
        self._send("GuiButtonHoldMessage", uuid=uuid, frequency=self.parts[uuid]["_hold_callback_freqs"][0])

    def click_map(self, x, y):
        """Click on a point of the ground, seen from above."""
        ray = {"ray_origin": (x, y, 9.0), "ray_direction": (0.0, 0.0, -1.0)}
        self._send("ScenePointerMessage", event_type="click", screen_pos=((0.5, 0.5),), modifier=None, **ray)

    def forge(self, uuid, value):
        """Say that a value has changed, whether it is shown here or not."""
        self._send("GuiUpdateMessage", uuid=uuid, updates={"value": value})

    def close(self):
        """Leave."""
        self._socket.close()
        self._thread.join(WAIT_S)
