"""Chromium without a window, driven by its own protocol (Chrome DevTools)."""

from __future__ import annotations

import base64
import json
import shutil
import subprocess
import tempfile
import time
import urllib.request

import cv2
import numpy as np

WAIT_S = 60.0
SOFTWARE_GL = ("--use-angle=swiftshader", "--enable-unsafe-swiftshader", "--ignore-gpu-blocklist")


def find_browser():
    """Return the program, None where there is none."""
    names = ("chromium", "chromium-browser", "google-chrome")
    return next((path for path in map(shutil.which, names) if path), None)


class Browser:
    """One page of one size."""

    def __init__(self, program, width=1000, height=700):
        from websockets.sync.client import connect

        self._folder = tempfile.TemporaryDirectory(prefix="browser_", ignore_cleanup_errors=True)
        options = ["--headless=new", "--no-sandbox", "--remote-debugging-port=0", f"--window-size={width},{height}"]
        words = [program, *options, *SOFTWARE_GL, f"--user-data-dir={self._folder.name}", "about:blank"]
        self._process = subprocess.Popen(words, stderr=subprocess.PIPE, stdout=subprocess.DEVNULL, text=True)
        try:
            line = next(line for line in self._process.stderr if "DevTools listening" in line)
            port = line.split(":")[-1].split("/")[0]
            pages = json.load(urllib.request.urlopen(f"http://127.0.0.1:{port}/json", timeout=WAIT_S))
            page = next(page for page in pages if page["type"] == "page")
            self._socket = connect(page["webSocketDebuggerUrl"], max_size=None)
        except BaseException:
            self._end()
            raise
        self._number = 0

    def call(self, method, **parameters):
        """Ask the browser for something and return what it answers."""
        self._number += 1
        self._socket.send(json.dumps({"id": self._number, "method": method, "params": parameters}))
        while True:
            answer = json.loads(self._socket.recv(timeout=WAIT_S))
            if answer.get("id") == self._number:
                return answer["result"]

    def screenshot(self):
        """Return what the page shows (H, W, 3) RGB."""
        data = base64.b64decode(self.call("Page.captureScreenshot", format="png")["data"])
        return cv2.imdecode(np.frombuffer(data, np.uint8), cv2.IMREAD_COLOR)[..., ::-1]

    def hold_key(self, key, seconds):
        """Hold a letter down."""
        code = {"key": key, "code": f"Key{key.upper()}", "windowsVirtualKeyCode": ord(key.upper())}
        self.call("Input.dispatchKeyEvent", type="keyDown", **code)
        time.sleep(seconds)
        self.call("Input.dispatchKeyEvent", type="keyUp", **code)

    def text(self):
        """Return what can be read on the page."""
        return self.call("Runtime.evaluate", expression="document.body.innerText")["result"].get("value") or ""

    def click(self, words, kind="button"):
        """Click with the mouse on the first visible element of a kind with just these words; whether there is one."""
        script = f"""(() => {{
            const found = [...document.querySelectorAll({json.dumps(kind)})].filter(
                (e) => (e.innerText || e.value || "").trim() == {json.dumps(words)} && e.offsetParent);
            if (!found.length) return null;
            found[0].scrollIntoView({{block: "center"}});
            const box = found[0].getBoundingClientRect();
            return [box.x + box.width / 2, box.y + box.height / 2];
        }})()"""
        place = self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value")
        for event in ("mousePressed", "mouseReleased") if place else ():
            x, y = place
            self.call("Input.dispatchMouseEvent", type=event, x=x, y=y, button="left", clickCount=1)
        return place is not None

    def fill(self, words, number=0):
        """Write into a visible text field, in place of what is there; return whether there is one."""
        script = f"""(() => {{
            const field = [...document.querySelectorAll("input")].filter(
                (e) => e.type == "text" && e.offsetParent && !e.readOnly && !e.value.startsWith("ws:"))[{number}];
            if (field) {{ field.focus(); field.select(); }}
            return !!field;
        }})()"""
        is_there = bool(self.call("Runtime.evaluate", expression=script, returnByValue=True)["result"].get("value"))
        if is_there:
            self.call("Input.insertText", text=words)
            time.sleep(0.3)
        return is_there

    def close(self):
        """End it."""
        self._socket.close()
        self._end()

    def _end(self):
        self._process.terminate()
        self._process.wait(WAIT_S)
        self._process.stderr.close()
        self._folder.cleanup()
