"""A headless Chromium that does as it is told: pages opened, mouse and keys moved, expressions evaluated, pictures taken.

It speaks the Chrome DevTools Protocol over two pipes, messages of JSON that end in a zero byte; no port, no driver, no package.
https://chromedevtools.github.io/devtools-protocol/
"""

from __future__ import annotations

import base64
import io
import json
import os
import select
import shutil
import subprocess
import tempfile
import time
from pathlib import Path
from typing import Any

import numpy as np
from PIL import Image

PROGRAM = shutil.which("chromium")
MISSING = "no chromium on this machine: apt-get install chromium"
SECONDS = 60.0  # that one answer may take


class Chromium:
    """One browser with one page."""

    def __init__(self, width: int = 1000, height: int = 1400) -> None:
        assert PROGRAM is not None
        self.folder = Path(tempfile.mkdtemp())
        (theirs_in, self.out), (self.into, theirs_out) = os.pipe(), os.pipe()
        command = [PROGRAM, "--headless=new", "--no-sandbox", "--remote-debugging-pipe", "--use-gl=angle", "--use-angle=swiftshader",
                   "--enable-unsafe-swiftshader", "--force-device-scale-factor=1", f"--user-data-dir={self.folder / 'profile'}",
                   f"--window-size={width},{height}", "--no-first-run", "--disable-background-networking", "--disable-dev-shm-usage"]
        # The browser reads from its descriptor 3 and writes to its 4.
        self.process = subprocess.Popen(["bash", "-c", f'exec "$@" 3<&{theirs_in} 4>&{theirs_out}', "bash", *command],
                                        pass_fds=(theirs_in, theirs_out), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(theirs_in)
        os.close(theirs_out)
        self.rest, self.number, self.session = b"", 0, ""
        self.said: list[dict[str, Any]] = []  # events: what the page logs and throws, what it loads
        target = self.send("Target.createTarget", url="about:blank")["targetId"]
        self.session = self.send("Target.attachToTarget", targetId=target, flatten=True)["sessionId"]
        for domain in ("Page", "Runtime", "Network", "Log"):
            self.send(f"{domain}.enable")
        self.send("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(self.folder))
        self.resize(width, height)

    def close(self) -> None:
        for pipe in (self.out, self.into):
            os.close(pipe)  # it ends when its pipe does
        self.process.wait(SECONDS)
        shutil.rmtree(self.folder, ignore_errors=True)

    def send(self, method: str, **parameters: Any) -> dict[str, Any]:
        self.number += 1
        session = {"sessionId": self.session} if self.session and not method.startswith(("Browser.", "Target.")) else {}
        os.write(self.out, json.dumps({"id": self.number, "method": method, "params": parameters} | session).encode() + b"\0")
        while (answer := self._read()).get("id") != self.number:
            self.said.append(answer)
        assert "error" not in answer, answer
        return answer["result"]

    def _read(self) -> dict[str, Any]:
        end = time.monotonic() + SECONDS
        while b"\0" not in self.rest:
            ready, _, _ = select.select([self.into], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"no answer within {SECONDS:.0f} s"
            more = os.read(self.into, 1 << 20)
            assert more, "the browser has ended"
            self.rest += more
        message, _, self.rest = self.rest.partition(b"\0")
        return json.loads(message)

    def resize(self, width: int, height: int) -> None:
        self.send("Emulation.setDeviceMetricsOverride", width=width, height=height, deviceScaleFactor=1, mobile=False)

    def scheme(self, name: str) -> None:
        """dark or light."""
        self.send("Emulation.setEmulatedMedia", features=[{"name": "prefers-color-scheme", "value": name}])

    def open(self, path: Path) -> None:
        self.said.clear()
        self.send("Page.navigate", url=path.resolve().as_uri())
        self.until("document.readyState === 'complete'")
        self.settle()

    def settle(self) -> None:
        """Wait for two pictures of the screen, after which what was asked for is drawn."""
        self.run("new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => done(1))))")

    def run(self, expression: str) -> Any:
        """The value of an expression of JavaScript, awaited."""
        found = self.send("Runtime.evaluate", expression=expression, awaitPromise=True, returnByValue=True)
        assert "exceptionDetails" not in found, found["exceptionDetails"]
        return found["result"].get("value")

    def until(self, expression: str) -> None:
        end = time.monotonic() + SECONDS
        while not self.run(expression):
            assert time.monotonic() < end, f"{expression} did not come true"
            time.sleep(0.05)

    def press(self, key: str) -> None:
        code = {"+": "Equal", "-": "Minus", "0": "Digit0"}.get(key, key)
        numbers = {"ArrowLeft": 37, "ArrowUp": 38, "ArrowRight": 39, "ArrowDown": 40, "End": 35, "Home": 36}
        text = {"text": key} if len(key) == 1 else {}
        for kind in ("keyDown", "keyUp"):
            self.send("Input.dispatchKeyEvent", type=kind, key=key, code=code, windowsVirtualKeyCode=numbers.get(key, 0),
                      **(text if kind == "keyDown" else {}))
        self.settle()

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        self.send("Input.dispatchMouseEvent", type=kind, x=x, y=y, **more)

    def drag(self, start: tuple[float, float], end: tuple[float, float], modifiers: int = 0) -> None:
        """Press the left button, move in five steps, let go; modifiers 8 is Shift."""
        held = {"button": "left", "buttons": 1, "modifiers": modifiers}
        self.mouse("mousePressed", *start, clickCount=1, **held)
        for part in np.linspace(0, 1, 6)[1:]:
            self.mouse("mouseMoved", *(a + part * (b - a) for a, b in zip(start, end, strict=True)), **held)
        self.mouse("mouseReleased", *end, clickCount=1, button="left", modifiers=modifiers)
        self.settle()

    def wheel(self, at: tuple[float, float], down: float) -> None:
        self.mouse("mouseWheel", *at, deltaX=0, deltaY=down)
        self.settle()

    def choose(self, what: str, text: str) -> None:
        """An option of a select, by its words."""
        self.run(f"""(() => {{ const select = document.querySelector({json.dumps(what)});
            select.value = [...select.options].find(option => option.text === {json.dumps(text)}).value;
            select.dispatchEvent(new Event("change", {{bubbles: true}})); }})()""")
        self.settle()

    def box(self, what: str) -> tuple[float, float, float, float]:
        """Left, top, width and height of an element, brought into view."""
        return tuple(self.run(f"""(() => {{ const part = document.querySelector({json.dumps(what)});
            part.scrollIntoView({{block: "center"}}); const box = part.getBoundingClientRect();
            return [box.left, box.top, box.width, box.height]; }})()"""))

    def click(self, what: str) -> None:
        left, top, width, height = self.box(what)
        held = {"button": "left", "clickCount": 1}
        self.mouse("mousePressed", left + width / 2, top + height / 2, **held)
        self.mouse("mouseReleased", left + width / 2, top + height / 2, **held)
        self.settle()

    def pixels(self, what: str) -> np.ndarray:
        """(height, width, 4) red, green, blue and opacity of a canvas, read back."""
        text = self.run(f"document.querySelector({json.dumps(what)}).toDataURL('image/png')")
        return np.asarray(Image.open(io.BytesIO(base64.b64decode(text.partition(",")[2]))).convert("RGBA")).astype(int)

    def screen(self, path: Path, whole: bool = False) -> None:
        """A picture of what is seen, or of the whole page."""
        path.write_bytes(base64.b64decode(self.send("Page.captureScreenshot", captureBeyondViewport=whole)["data"]))

    def download(self, what: str, ending: str) -> bytes:
        """Click on a button, and give the file that came."""
        before = set(self.folder.iterdir())
        self.click(what)
        end = time.monotonic() + SECONDS
        while not (new := [path for path in set(self.folder.iterdir()) - before if path.suffix == ending and path.stat().st_size]):
            assert time.monotonic() < end, f"no {ending} came"
            time.sleep(0.05)
        content = new[0].read_bytes()
        new[0].unlink()  # a second one of this name would take its place
        return content
