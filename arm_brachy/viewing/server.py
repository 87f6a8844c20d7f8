"""A web server for one person on this machine: a page, and what it asks for.

Only 127.0.0.1 is listened on, and only requests for that name are answered, so that a page from
elsewhere cannot reach it under a name of its own. What changes anything must carry the token that
the page was given.
"""

import hmac
import secrets
import threading
from dataclasses import dataclass
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from urllib.parse import parse_qs, urlsplit

from arm_brachy.core.errors import InputError

HOST = '127.0.0.1'
TOKEN = 'X-Arm-Brachy-Token'
POLICY = ("default-src 'none'; script-src 'unsafe-inline'; style-src 'unsafe-inline'; "
          "img-src 'self' data:; connect-src 'self'")
LONGEST_BODY = 4096    # bytes of a request that changes something


@dataclass(frozen=True)
class Answer:
    """What is sent back. kind : media type;  body : bytes, or an iterable of bytes that flows."""

    kind: str
    body: object


class PageServer(ThreadingHTTPServer):
    """Answers `pages` (path -> callable(query) -> Answer or None) and `actions` (body -> Answer).

    Raises InputError if the port is taken.
    """

    daemon_threads = True

    def __init__(self, port, pages, actions=()):
        """port : 0 takes a free one;  actions : path -> callable(bytes) -> Answer."""
        self.pages, self.actions = dict(pages), dict(actions)
        self.token = secrets.token_urlsafe(16)
        try:
            super().__init__((HOST, port), _Handler)
        except OSError as error:
            raise InputError(f'port {port} of {HOST}: {error.strerror}; give another with --port'
                             ) from None

    @property
    def address(self):
        """What to type into a browser."""
        return f'http://{HOST}:{self.server_address[1]}/'

    def start(self):
        """Serve in a thread of its own; returns it."""
        thread = threading.Thread(target=self.serve_forever, daemon=True)
        thread.start()
        return thread


class _Handler(BaseHTTPRequestHandler):
    protocol_version = 'HTTP/1.1'

    def do_GET(self):
        """Answer with a page of the server, whole or part by part as it comes."""
        url = urlsplit(self.path)
        page = self.server.pages.get(url.path)
        if self._foreign():
            return
        answer = None if page is None else page(parse_qs(url.query))
        if answer is None:
            self._refuse(HTTPStatus.NOT_FOUND)
        elif isinstance(answer.body, bytes):
            self._send(answer)
        else:
            self._flow(answer)

    def do_POST(self):
        """Carry out an action of the server for whoever has the page's token."""
        action = self.server.actions.get(self.path)
        size = int(self.headers.get('Content-Length') or 0)
        token = self.headers.get(TOKEN) or ''
        if self._foreign():
            return
        if action is None or not 0 <= size <= LONGEST_BODY:
            self._refuse(HTTPStatus.NOT_FOUND)
        elif not hmac.compare_digest(token.encode(), self.server.token.encode()):
            self._refuse(HTTPStatus.FORBIDDEN)
        else:
            self._send(action(self.rfile.read(size)))

    def _foreign(self):
        """Refuse a request that was made for another name than ours."""
        host = (self.headers.get('Host') or '').rsplit(':', 1)[0]
        if host in (HOST, 'localhost'):
            return False
        self._refuse(HTTPStatus.FORBIDDEN)
        return True

    def _send(self, answer):
        self._head(HTTPStatus.OK, answer.kind, len(answer.body))
        self.wfile.write(answer.body)

    def _flow(self, answer):
        self.close_connection = True
        self._head(HTTPStatus.OK, answer.kind, None)
        try:
            for part in answer.body:
                self.wfile.write(part)
                self.wfile.flush()
        except (BrokenPipeError, ConnectionResetError):   # the page was closed
            pass

    def _refuse(self, status):
        self.close_connection = True
        self._head(status, 'text/plain', len(status.phrase))
        self.wfile.write(status.phrase.encode())

    def _head(self, status, kind, size):
        self.send_response(status)
        self.send_header('Content-Type', kind)
        self.send_header('Content-Security-Policy', POLICY)
        self.send_header('Cache-Control', 'no-store')
        if size is not None:
            self.send_header('Content-Length', str(size))
        self.end_headers()

    def log_message(self, format, *args):
        """Say nothing: the terminal belongs to the command."""
