"""Open every page of the built site in headless Chromium, and search it.

``python docs/check_in_browser.py SITE [SCREENSHOTS]`` ends with 1 if a page logs an error, asks
another host, lacks an image or a formula, or if the search does not find the right page first. It
speaks to Chromium (Debian's package ``chromium``) in its own protocol.
"""

import base64
import functools
import http.server
import json
import pathlib
import shutil
import subprocess
import sys
import tempfile
import threading
import time
import urllib.parse
import urllib.request

import websocket

# Formulas that are drawn, as [width, height], and those that the page has.
FORMULAS = """[...document.querySelectorAll('mjx-container')].map(e => {
    const box = e.getBoundingClientRect(); return [box.width, box.height]; })"""
WRITTEN = "document.querySelectorAll('span.math, div.math').length"
FAULTS = "document.querySelectorAll('mjx-merror, [data-mjx-error], merror').length"
BROKEN = "[...document.images].filter(i => !i.complete || !i.naturalWidth).map(i => i.src)"
TYPESET = "window.MathJax?.startup?.promise?.then(() => true) ?? true"
HITS = "[...document.querySelectorAll('#search-results li > a')]"
SEARCHED = "document.querySelector('#search-results .search-summary')?.innerText.includes('found')"


# What is searched for, and the page that is to be the first hit.
SOUGHT = {
    "NaN": "troubleshooting",
    "install": "index",
    "slow": "troubleshooting",
    "stiff": "stability",
}


class Quiet(http.server.SimpleHTTPRequestHandler):
    """A server of files that logs nothing."""

    def log_message(self, *args):
        """Log nothing."""


def serve(folder):
    """Serve a folder to this machine alone; return its address."""
    handler = functools.partial(Quiet, directory=folder)
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    return f"http://127.0.0.1:{server.server_port}"


def until(condition, seconds=30):
    """Wait until a condition holds."""
    end = time.monotonic() + seconds
    while not condition():
        if time.monotonic() > end:
            raise TimeoutError("the browser did not get there")
        time.sleep(0.05)


class Browser:
    """One tab of headless Chromium."""

    def __init__(self):
        self._profile = tempfile.mkdtemp()
        flags = ["--headless", "--no-sandbox", "--disable-gpu", "--disable-dev-shm-usage"]
        flags += ["--no-first-run", "--disable-background-networking", "--hide-scrollbars"]
        flags += [f"--user-data-dir={self._profile}", "--remote-debugging-port=0", "about:blank"]
        quiet = {"stdout": subprocess.DEVNULL, "stderr": subprocess.DEVNULL}
        self._process = subprocess.Popen(["chromium", *flags], **quiet)
        told = pathlib.Path(self._profile, "DevToolsActivePort")
        until(lambda: told.exists() and "\n" in told.read_text())
        with urllib.request.urlopen(f"http://127.0.0.1:{told.read_text().split()[0]}/json") as tabs:
            tab = next(tab for tab in json.load(tabs) if tab["type"] == "page")
        address = tab["webSocketDebuggerUrl"]
        # with an origin Chromium answers 403
        self._socket = websocket.create_connection(address, timeout=60, suppress_origin=True)
        self._number, self._events = 0, []
        for domain in ("Page", "Runtime", "Log", "Network"):
            self._call(f"{domain}.enable")
        size = {"width": 1280, "height": 900, "deviceScaleFactor": 1, "mobile": False}
        self._call("Emulation.setDeviceMetricsOverride", **size)

    def _call(self, method, **params):
        self._number += 1
        call = {"id": self._number, "method": method, "params": params}
        self._socket.send(json.dumps(call))
        while True:
            message = json.loads(self._socket.recv())
            if message.get("id") == self._number:
                if "error" in message:
                    raise RuntimeError(f"{method}: {message['error']}")
                return message["result"]
            self._events.append(message)

    def value(self, expression):
        """Return the value of an expression on the page."""
        how = {"awaitPromise": True, "returnByValue": True}
        found = self._call("Runtime.evaluate", expression=expression, **how)
        if "exceptionDetails" in found:
            raise RuntimeError(found["exceptionDetails"]["exception"]["description"])
        return found["result"].get("value")

    def open(self, address, then="true"):
        """Open a page, wait until it is there, its formulas are drawn and `then` holds."""
        self._events.clear()
        self._call("Page.navigate", url=address)
        here = f"location.href.startsWith({json.dumps(address)})"
        until(lambda: self.value(f"{here} && document.readyState == 'complete' && !!({then})"))
        self.value(TYPESET)

    def complaints(self):
        """List errors and warnings of the console, and requests to other hosts."""
        found = []
        for event in self._events:
            method, told = event["method"], event["params"]
            if method == "Runtime.exceptionThrown":
                found.append(told["exceptionDetails"]["exception"].get("description"))
            elif method == "Runtime.consoleAPICalled" and told["type"] in ("error", "warning"):
                found.append(str([argument.get("value") for argument in told["args"]]))
            elif method == "Log.entryAdded" and told["entry"]["level"] in ("error", "warning"):
                found.append(f"{told['entry']['text']} {told['entry'].get('url', '')}")
            elif method == "Network.requestWillBeSent":
                asked = urllib.parse.urlsplit(told["request"]["url"])
                if asked.scheme.startswith("http") and asked.hostname != "127.0.0.1":
                    found.append(f"asks {asked.hostname}")
        return found

    def screenshot(self, path):
        """Write a picture of what is seen."""
        data = self._call("Page.captureScreenshot", format="png")["data"]
        pathlib.Path(path).write_bytes(base64.b64decode(data))

    def close(self):
        """End the browser."""
        self._socket.close()
        self._process.terminate()
        self._process.wait(20)
        shutil.rmtree(self._profile, ignore_errors=True)


def faults_of(browser):
    """List what is wrong with the page that is open."""
    found = browser.complaints()
    boxes, written = browser.value(FORMULAS), browser.value(WRITTEN)
    if len(boxes) != written or browser.value(FAULTS):
        found.append(f"{len(boxes)} of {written} formulas drawn, {browser.value(FAULTS)} faulty")
    if any(width < 2 or height < 2 for width, height in boxes):
        found.append("formulas without a size")
    return found + [f"no image {source}" for source in browser.value(BROKEN)]


def main(site, screenshots=None):
    """Open all pages; return the number of those with faults."""
    root, browser, bad, formulas = serve(site), Browser(), 0, 0
    pages = sorted(str(path.relative_to(site)) for path in pathlib.Path(site).rglob("*.html"))
    try:
        for page in pages:
            browser.open(f"{root}/{page}")
            faults = faults_of(browser)
            formulas += browser.value(WRITTEN)
            if faults:
                bad += 1
                print(f"{page}: {'; '.join(faults)}")
            if screenshots:
                pathlib.Path(screenshots).mkdir(parents=True, exist_ok=True)
                browser.screenshot(pathlib.Path(screenshots, page.replace("/", "_") + ".png"))
        for word, page in SOUGHT.items():
            browser.open(f"{root}/search.html?q={word}", f"{HITS}.length && {SEARCHED}")
            hits = browser.value(f"{HITS}.map(link => link.href)")
            if f"/{page}.html" not in hits[0] or browser.complaints():
                bad += 1
                print(f"search for {word}: {hits[:5]} {browser.complaints()}")
        if screenshots:
            browser.screenshot(pathlib.Path(screenshots, "search.png"))
    finally:
        browser.close()
    print(f"{len(pages)} pages, {formulas} formulas, {len(SOUGHT)} searches, {bad} bad")
    return bad


if __name__ == "__main__":
    sys.exit(bool(main(*sys.argv[1:])))
