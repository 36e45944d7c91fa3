"""A page in headless Chromium: what it shows, says on its console and asks for.

The browser is spoken to in its DevTools protocol, JSON ended by zero bytes, through the pipes that
``--remote-debugging-pipe`` reads from and writes to as file descriptors 3 and 4.
"""

from __future__ import annotations

import base64
import contextlib
import json
import os
import select
import shutil
import signal
import subprocess
import sys
import tempfile
import time
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any, Self

if TYPE_CHECKING:
    from pathlib import Path

NAMES = ("chromium", "chromium-browser", "google-chrome", "google-chrome-stable")
PATIENCE_S = 90
"""Elapsed time after which a browser that does not answer is a failure."""

_PIPES = 'exec "$0" "$@" 3<&0 4>&1 </dev/null >/dev/null 2>&1'
_OPTIONS = (
    "--headless=new", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage", "--no-first-run",
    "--disable-background-networking", "--hide-scrollbars", "--force-color-profile=srgb",
    "--host-resolver-rules=MAP * ~NOTFOUND", "--remote-debugging-pipe",
)  # fmt: skip


def executable() -> str | None:
    """Path of Chromium or Chrome; None where there is none, or no pipes with fixed numbers."""
    if sys.platform == "win32":
        return None
    return next((path for name in NAMES if (path := shutil.which(name))), None)


@dataclass(frozen=True, kw_only=True)
class Visit:
    """What came of opening a page."""

    title: str
    text: str
    """As it is shown."""
    complaints: tuple[str, ...]
    """Errors and warnings of the console, exceptions of scripts, failed loads."""
    requests: tuple[str, ...]
    """Addresses asked for beside the page itself and ``data:``."""
    overflow: int
    """px that the page is wider than the window."""
    broken: tuple[str, ...]
    """Alternative texts of images that have no pixels."""
    png: bytes
    """The whole page as a picture."""


class Browser:
    """Headless Chromium with a profile of its own, as a context manager."""

    def __init__(self, path: str) -> None:
        self._profile = tempfile.TemporaryDirectory(ignore_cleanup_errors=True)
        command = [path, *_OPTIONS, f"--user-data-dir={self._profile.name}", "about:blank"]
        self._process = subprocess.Popen(
            ["sh", "-c", _PIPES, *command],
            stdin=subprocess.PIPE,
            stdout=subprocess.PIPE,
            start_new_session=True,
        )
        self._unread = b""
        self._sent = 0

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *_: object) -> None:
        with contextlib.suppress(ProcessLookupError):
            os.killpg(self._process.pid, signal.SIGKILL)
        self._process.communicate()
        self._profile.cleanup()

    def visit(
        self, page: Path, *, size: tuple[int, int] = (1200, 900), dark: bool = False
    ) -> Visit:
        """Open a file in a tab of its own until it has asked for nothing for half a second.

        Parameters
        ----------
        page : Path
        size : int, int
            Width and height of the window, px.
        dark : bool
            Whether the reader prefers dark pages.
        """
        events: list[dict[str, Any]] = []
        target = self._call("Target.createTarget", events, url="about:blank")["targetId"]
        session = self._call("Target.attachToTarget", events, targetId=target, flatten=True)
        tab = session["sessionId"]

        def call(method: str, **values: Any) -> dict[str, Any]:
            return self._call(method, events, tab, **values)

        for domain in ("Page", "Runtime", "Log", "Network"):
            call(f"{domain}.enable")
        call("Page.setLifecycleEventsEnabled", enabled=True)
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        call("Emulation.setEmulatedMedia", features=[scheme])
        width, height = size
        call(
            "Emulation.setDeviceMetricsOverride",
            width=width, height=height, deviceScaleFactor=1, mobile=False,
        )  # fmt: skip
        loader = call("Page.navigate", url=page.resolve().as_uri())["loaderId"]
        while not any(_is_quiet(event, loader) for event in events):
            events.append(self._read())

        def ask(script: str) -> Any:
            return call("Runtime.evaluate", expression=script, returnByValue=True)["result"][
                "value"
            ]

        png = call("Page.captureScreenshot", captureBeyondViewport=True)["data"]
        found = Visit(
            title=ask("document.title"),
            text=ask("document.body.innerText"),
            complaints=tuple(text for event in events if (text := _complaint(event))),
            requests=tuple(_requests(events, page.resolve().as_uri())),
            overflow=ask("document.documentElement.scrollWidth - window.innerWidth"),
            broken=tuple(ask("[...document.images].filter(i => !i.naturalWidth).map(i => i.alt)")),
            png=base64.b64decode(png),
        )
        self._call("Target.closeTarget", [], targetId=target)
        return found

    def _call(
        self, method: str, events: list[dict[str, Any]], tab: str | None = None, **values: Any
    ) -> dict[str, Any]:
        """Send a command and return its result; events that come before it are collected."""
        self._sent += 1
        message = {"id": self._sent, "method": method, "params": values}
        if tab is not None:
            message["sessionId"] = tab
        assert self._process.stdin is not None
        self._process.stdin.write(json.dumps(message).encode() + b"\0")
        self._process.stdin.flush()
        while (answer := self._read()).get("id") != self._sent:
            events.append(answer)
        assert "error" not in answer, f"{method}: {answer['error']}"
        return answer["result"]

    def _read(self) -> dict[str, Any]:
        assert self._process.stdout is not None
        pipe, end = self._process.stdout.fileno(), time.monotonic() + PATIENCE_S
        while b"\0" not in self._unread:
            ready, _, _ = select.select([pipe], [], [], max(0.0, end - time.monotonic()))
            assert ready, f"the browser has not answered for {PATIENCE_S} s"
            piece = os.read(pipe, 1 << 16)
            assert piece, "the browser ended"
            self._unread += piece
        message, _, self._unread = self._unread.partition(b"\0")
        return json.loads(message)


def _is_quiet(event: dict[str, Any], loader: str) -> bool:
    values = event.get("params", {})
    named = event.get("method"), values.get("name"), values.get("loaderId")
    return named == ("Page.lifecycleEvent", "networkIdle", loader)


def _complaint(event: dict[str, Any]) -> str | None:
    values = event.get("params", {})
    match event.get("method"):
        case "Runtime.exceptionThrown":
            details = values["exceptionDetails"]
            return details.get("exception", {}).get("description", details["text"])
        case "Runtime.consoleAPICalled" if values["type"] in {"error", "warning", "assert"}:
            return " ".join(str(each.get("value", "")) for each in values["args"])
        case "Log.entryAdded" if values["entry"]["level"] in {"error", "warning"}:
            return values["entry"]["text"]
    return None


def _requests(events: list[dict[str, Any]], own: str) -> list[str]:
    asked = (event for event in events if event.get("method") == "Network.requestWillBeSent")
    addresses = (event["params"]["request"]["url"] for event in asked)
    return [address for address in addresses if address != own and not address.startswith("data:")]
