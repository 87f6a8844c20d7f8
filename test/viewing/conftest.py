"""A browser without a window, driven over a pipe; tests that need one skip where there is none."""

import contextlib
import json
import os
import shutil
import subprocess
import tempfile

import numpy as np
import pytest
import trimesh

from arm_brachy.viewing.drawing import Stage, Truth, draw_truth
from arm_brachy.viewing.film import Film
from arm_brachy.viewing.surface import thinned

CHROMIUM = next(filter(None, map(shutil.which, ('chromium', 'chromium-browser',
                                                'google-chrome'))), None)
FLAGS = ('--headless', '--no-sandbox', '--use-angle=swiftshader', '--enable-unsafe-swiftshader',
         '--window-size=1200,800', '--remote-debugging-pipe')


class Browser:
    """A page of Chromium, over its debugging protocol on the pipes 3 and 4."""

    def __init__(self, folder):
        down, self._in = os.pipe()
        self._out, up = os.pipe()
        self._process = subprocess.Popen(
            ['bash', '-c', f'exec "$@" 3<&{down} 4>&{up}', '-', CHROMIUM, *FLAGS,
             f'--user-data-dir={folder}', 'about:blank'], pass_fds=(down, up),
            stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL)
        os.close(down)
        os.close(up)
        self._number, self._rest, self.asked, self.said = 0, b'', [], []
        self._session = None
        target = self.call('Target.createTarget', url='about:blank')['targetId']
        self._session = self.call('Target.attachToTarget', targetId=target,
                                  flatten=True)['sessionId']
        for domain in ('Page', 'Network', 'Runtime'):
            self.call(f'{domain}.enable')

    def call(self, method, **params):
        """Call a method of the protocol; what happened meanwhile is kept."""
        self._number += 1
        message = {'id': self._number, 'method': method, 'params': params}
        if self._session:
            message['sessionId'] = self._session
        os.write(self._in, json.dumps(message).encode() + b'\0')
        while (answer := self._next()).get('id') != self._number:
            self._note(answer)
        assert 'error' not in answer, answer['error']
        return answer['result']

    def _next(self):
        while b'\0' not in self._rest:
            part = os.read(self._out, 1 << 16)
            assert part, 'the browser has ended'
            self._rest += part
        one, _, self._rest = self._rest.partition(b'\0')
        return json.loads(one)

    def _note(self, event):
        params = event.get('params', {})
        if event.get('method') == 'Network.requestWillBeSent':
            self.asked.append(params['request']['url'])
        if event.get('method') in ('Runtime.exceptionThrown', 'Runtime.consoleAPICalled'):
            self.said.append(params)

    def open(self, address):
        """Go to a page and wait until it is loaded."""
        self.call('Page.navigate', url=address)
        while self.run('document.readyState') != 'complete' or self.run(
                'location.href') == 'about:blank':
            pass

    def run(self, code):
        """Value of JavaScript in the page; a promise is waited for."""
        found = self.call('Runtime.evaluate', expression=code, awaitPromise=True,
                          returnByValue=True)
        assert 'exceptionDetails' not in found, found
        return found['result'].get('value')

    def close(self):
        """End the browser."""
        with contextlib.suppress(OSError, AssertionError):
            self.call('Browser.close')
        self._process.wait(20)
        os.close(self._in)
        os.close(self._out)


@pytest.fixture(scope='module')
def browser():
    """A Browser; skips by name where there is none."""
    if CHROMIUM is None:
        pytest.skip('no chromium on this machine')
    with tempfile.TemporaryDirectory() as folder:
        one = Browser(folder)
        yield one
        one.close()


@pytest.fixture(scope='module')
def film():
    """Forty frames of a ball of 2 k triangles that is pressed flat, with its middle marked."""
    ball = trimesh.creation.icosphere(subdivisions=4, radius=0.05)
    nodes, faces = np.array(ball.vertices), np.array(ball.faces)
    thin, stage, out = thinned(nodes, faces, 2000), Stage(), Film(0.02)
    for k in range(40):
        pressed = nodes * [1.0, 1.0, 1.0 - 0.4 * k / 40]
        out.add(0.2 * k, draw_truth(stage, Truth((thin, pressed), {'middle': np.zeros(3)})))
    return out
