"""A page in headless Chromium that renders models with three.js."""

import contextlib
import json
import mimetypes
import queue
import shutil
import tempfile
import threading
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from subprocess import DEVNULL, Popen
from typing import Any, Optional, Tuple
from urllib.parse import unquote, urlparse

PAGE = Path(__file__).resolve().parent / "page"
# SwiftShader, so that the images do not depend on a graphics card. Only pages of our own server are
# opened, and containers have no other sandbox inside them.
OPTIONS = [
    "--headless=new",
    "--no-sandbox",
    "--disable-dev-shm-usage",
    "--use-gl=angle",
    "--use-angle=swiftshader",
    "--enable-unsafe-swiftshader",
    "--disable-background-networking",
    "--no-first-run",
]


def program() -> Optional[str]:
    """Chromium, if it is installed."""
    found = (shutil.which(name) for name in ("chromium", "chromium-browser", "google-chrome"))
    return next((path for path in found if path), None)


class Browser:
    """Runs one page; jobs are rendered one after the other."""

    def __init__(self, chromium: str, modules: Path, models: Path, seconds: float = 60.0) -> None:
        self.seconds = seconds
        # Set when the page asks for its first job.
        self.ready = threading.Event()
        self.broken = False
        self.jobs: "queue.Queue[Any]" = queue.Queue()
        self.results: "queue.Queue[Tuple[bool, bytes]]" = queue.Queue()
        folders = {"modules": modules, "models": models, "page": PAGE}
        jobs, results, ready = self.jobs, self.results, self.ready

        class Handler(BaseHTTPRequestHandler):
            def do_GET(self) -> None:
                path = unquote(urlparse(self.path).path)
                if path == "/job":
                    ready.set()
                    try:
                        job = jobs.get(timeout=2)
                    except queue.Empty:
                        job = None
                    return self.reply(200, "application/json", json.dumps(job).encode())
                first, _, rest = path.strip("/").partition("/")
                file = (folders.get(first, PAGE) / rest).resolve()
                allowed = first in folders and file.is_relative_to(folders[first].resolve())
                if not allowed or not file.is_file():
                    return self.reply(404, "text/plain", b"")
                kind = "text/javascript" if file.suffix == ".js" else mimetypes.guess_type(file.name)[0]
                self.reply(200, kind or "application/octet-stream", file.read_bytes())

            def do_POST(self) -> None:
                body = self.rfile.read(int(self.headers.get("Content-Length", 0)))
                results.put((self.path == "/done", body))
                self.reply(200, "text/plain", b"")

            def reply(self, status: int, kind: str, body: bytes) -> None:
                # At the end the page is no longer there to read the answer.
                with contextlib.suppress(ConnectionError):
                    self.send_response(status)
                    self.send_header("Content-Type", kind)
                    self.send_header("Content-Length", str(len(body)))
                    self.send_header("Cache-Control", "no-store")
                    self.end_headers()
                    self.wfile.write(body)

            def log_message(self, format: str, *arguments: Any) -> None:
                pass

        self.server = ThreadingHTTPServer(("127.0.0.1", 0), Handler)
        self.server.daemon_threads = True
        threading.Thread(target=self.server.serve_forever, daemon=True).start()
        self.profile = tempfile.mkdtemp(prefix="whitstone-chromium-")
        address = f"http://127.0.0.1:{self.server.server_address[1]}/page/index.html"
        arguments = [chromium, *OPTIONS, f"--user-data-dir={self.profile}", address]
        self.process = Popen(arguments, stdin=DEVNULL, stdout=DEVNULL, stderr=DEVNULL)

    def render(self, job: Any) -> bytes:
        """The result of a job; an exception with the page's message if it fails."""
        if self.broken:
            raise RuntimeError("the page has stopped")
        self.jobs.put(job)
        try:
            done, body = self.results.get(timeout=self.seconds)
        except queue.Empty:
            self.broken = True
            raise TimeoutError(f"the page did not answer within {self.seconds} s") from None
        if not done:
            raise RuntimeError(body.decode(errors="replace"))
        return body

    def close(self) -> None:
        self.process.terminate()
        self.process.wait()
        self.server.shutdown()
        self.server.server_close()
        shutil.rmtree(self.profile, ignore_errors=True)
