"""Chromium without a window, over the pipe of its DevTools protocol; standard library only."""

import base64
from collections.abc import Iterator
from contextlib import contextmanager
import fcntl
import json
import os
from pathlib import Path
import select
import shutil
import subprocess
import time
from typing import Any

CHROMIUM = next(filter(None, map(shutil.which, (
    'chromium', 'chromium-browser', 'google-chrome'))), None)
FLAGS = (
    '--headless=new', '--no-sandbox', '--disable-gpu', '--disable-quic', '--no-first-run',
    '--disable-background-networking', '--disable-component-update', '--disable-sync',
    '--disable-dev-shm-usage', '--remote-debugging-pipe',
)
PATIENCE = 60.0  # [s]


class Browser:
    """One page; everything that it asks for and complains about is kept."""

    def __init__(self, process: subprocess.Popen[bytes], read: int, write: int) -> None:
        self._process, self._read, self._write = process, read, write
        self._buffer = b''
        self._number = 0
        self._session: str | None = None
        self.requests: list[str] = []
        self.complaints: list[str] = []
        self.events: list[str] = []
        page = self.call('Target.createTarget', url='about:blank')['targetId']
        self._session = self.call(
            'Target.attachToTarget', targetId=page, flatten=True)['sessionId']
        for domain in ('Page', 'Runtime', 'Network', 'Log'):
            self.call(f'{domain}.enable')

    def call(self, method: str, **parameters: Any) -> dict[str, Any]:
        """Call the browser and return its answer."""
        self._number += 1
        number = self._number
        message = {'id': number, 'method': method, 'params': parameters}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._write, json.dumps(message).encode() + b'\0')
        while True:
            answer = self._message()
            if answer.get('id') == number:
                assert 'error' not in answer, (method, answer['error'])
                return answer['result']
            self._note(answer)

    def open(self, path: Path) -> None:
        """Load a file and wait until its script has run."""
        self.events.clear()
        self.call('Page.navigate', url=path.as_uri())
        while 'Page.loadEventFired' not in self.events:
            self._note(self._message())

    def evaluate(self, expression: str) -> Any:
        """Return the value of JavaScript, which may be a promise."""
        answer = self.call('Runtime.evaluate', expression=expression, returnByValue=True,
                           awaitPromise=True)
        assert 'exceptionDetails' not in answer, answer['exceptionDetails']
        return answer['result'].get('value')

    def settle(self) -> None:
        """Wait until what was asked for has been drawn."""
        self.evaluate('new Promise(done => requestAnimationFrame('
                      '() => requestAnimationFrame(() => done(0))))')

    def resize(self, width: int, height: int = 900, *, phone: bool = False) -> None:
        """Give the page another size [px]."""
        self.call('Emulation.setDeviceMetricsOverride', width=width, height=height,
                  deviceScaleFactor=2 if phone else 1, mobile=phone)

    def mouse(self, kind: str, x: float, y: float, **more: Any) -> None:
        """Send an event of the mouse at a place in the window."""
        self.call('Input.dispatchMouseEvent', type=kind, x=x, y=y, **more)

    def screenshot(self, path: Path, *, whole: bool = False) -> None:
        """Save what the window shows, or the whole page."""
        data = self.call('Page.captureScreenshot', captureBeyondViewport=whole)['data']
        path.write_bytes(base64.b64decode(data))

    def _message(self) -> dict[str, Any]:
        deadline = time.monotonic() + PATIENCE
        while b'\0' not in self._buffer:
            ready, _, _ = select.select([self._read], [], [], deadline - time.monotonic())
            chunk = os.read(self._read, 1 << 20) if ready else b''
            assert chunk, f'no answer from the browser (exit {self._process.poll()})'
            self._buffer += chunk
        message, _, self._buffer = self._buffer.partition(b'\0')
        return json.loads(message)

    def _note(self, message: dict[str, Any]) -> None:
        method, parameters = message.get('method', ''), message.get('params', {})
        self.events.append(method)
        if method == 'Network.requestWillBeSent':
            self.requests.append(parameters['request']['url'])
        elif method == 'Runtime.exceptionThrown':
            self.complaints.append(str(parameters['exceptionDetails']))
        elif method == 'Runtime.consoleAPICalled' and parameters['type'] in ('error', 'warning'):
            self.complaints.append(str(parameters['args']))
        elif method == 'Log.entryAdded':
            self.complaints.append(parameters['entry']['text'])


@contextmanager
def browser(profile: Path) -> Iterator[Browser]:
    """Start Chromium with a fresh profile folder."""
    assert CHROMIUM is not None
    ours, theirs = os.pipe(), os.pipe()  # (read, write): of the browser's input and output
    ends = [fcntl.fcntl(end, fcntl.F_DUPFD_CLOEXEC, 10) for end in (ours[0], theirs[1])]

    def connect() -> None:  # the browser reads from descriptor 3 and writes to 4
        os.dup2(ends[0], 3)
        os.dup2(ends[1], 4)

    with (profile / 'stderr').open('wb') as errors:
        process = subprocess.Popen(
            [CHROMIUM, *FLAGS, f'--user-data-dir={profile}'], preexec_fn=connect,
            close_fds=False, stdin=subprocess.DEVNULL, stdout=errors, stderr=errors)
    for end in (ours[0], theirs[1], *ends):
        os.close(end)
    try:
        yield Browser(process, theirs[0], ours[1])
    finally:
        process.terminate()
        process.wait(PATIENCE)
        os.close(theirs[0])
        os.close(ours[1])
