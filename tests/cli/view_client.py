# SPDX-License-Identifier: Apache-2.0
"""A running `pags view` and a client for it. The client sends HTTP requests byte by byte and opens a WebSocket, so
tests can send data that no browser sends."""

import base64
import json
import os
import re
import signal
import socket
import struct
import subprocess
import sys
import tempfile
import time
import unittest

import fixtures

PATIENCE = 30  # seconds to wait for an answer


class Listener:
    """A server at a printed address, and requests to it. Derived classes set `process`."""

    def listen(self, url):
        self.url = url
        self.port = int(re.search(r":(\d+)/", url).group(1))
        self.token = re.search(r"token=([0-9a-f]+)$", url).group(1)
        self.host = f"127.0.0.1:{self.port}"
        self.patience = PATIENCE  # seconds that a request waits for its answer
        self.cookie = f"pags_{self.port}={self.token}"

    def memory(self):
        """Returns the resident memory of the server in bytes."""
        with open(f"/proc/{self.process.pid}/statm", encoding="ascii") as file:
            return int(file.read().split()[1]) * os.sysconf("SC_PAGE_SIZE")

    def connect(self):
        line = socket.create_connection(("127.0.0.1", self.port), timeout=self.patience)
        line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
        return line

    def headers(self, **changed):
        """Returns the headers that the viewer's page sends. `changed` replaces headers; the value None removes a
        header."""
        headers = {"Host": self.host, "Cookie": self.cookie, "Connection": "close"}
        headers.update({name.replace("_", "-"): value for name, value in changed.items()})
        return "".join(f"{name}: {value}\r\n" for name, value in headers.items() if value is not None)

    def get(self, path, method="GET", **changed):
        """Returns the status, headers and body of an answer. The status is 0 if the connection was closed without an
        answer."""
        return self.send(f"{method} {path} HTTP/1.1\r\n{self.headers(**changed)}\r\n".encode())

    def send(self, request):
        data = b""
        try:
            with self.connect() as line:
                line.sendall(request)
                while chunk := line.recv(65536):
                    data += chunk
        except (ConnectionResetError, BrokenPipeError):
            pass
        head, _, body = data.partition(b"\r\n\r\n")
        found = re.match(rb"HTTP/1\.[01] (\d+)", head)
        lines = [line.partition(":") for line in head.decode("latin-1").split("\r\n")[1:]]
        return int(found.group(1)) if found else 0, {name.lower(): value.strip() for name, _, value in lines}, body


class Server(Listener):
    """A `pags view` of a scene on a free port. close() ends it."""

    def __init__(self, scene, *options):
        self.folder = tempfile.TemporaryDirectory(prefix="pags-view-")
        report = os.path.join(self.folder.name, "view.json")
        command = fixtures.program(["view", scene, "--port", "0", "--json", report, "-q", *options])
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.PIPE, text=True)
        end = time.monotonic() + PATIENCE
        while not os.path.exists(report):
            if self.process.poll() is not None or time.monotonic() > end:
                self.process.kill()
                raise AssertionError(f"pags view doesn't listen: {self.process.communicate()}")
            time.sleep(0.02)
        with open(report, encoding="utf-8") as file:
            self.facts = json.load(file)
        self.listen(self.facts["url"])

    def close(self, how=signal.SIGINT):
        """Ends the server by Ctrl-C. Returns its exit code and stderr."""
        if self.process.poll() is None:
            self.process.send_signal(how)
        _, errors = self.process.communicate(timeout=PATIENCE)
        self.folder.cleanup()
        return self.process.returncode, errors


class Run(Listener):
    """A `pags train --view` on a free port. `output` holds its output after its end."""

    def __init__(self, *arguments):
        command = fixtures.program(["train", *arguments, "--view", "0"])
        self.process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.STDOUT, text=True)
        self.output = ""
        while not (found := re.search(r"http://\S+", self.output)):
            line = self.process.stdout.readline()
            if not line:
                raise AssertionError(f"pags train --view doesn't listen: {self.process.wait()}: {self.output}")
            self.output += line
        self.listen(found.group())

    def description(self):
        """Returns scene.json when the first step is done."""
        end = time.monotonic() + PATIENCE
        while time.monotonic() < end:
            status, _, body = self.get("/scene.json")
            if status == 200:
                return json.loads(body)
            if status != 503:
                raise AssertionError((status, body))
            time.sleep(0.02)
        raise AssertionError("the run doesn't begin")

    def wait(self):
        """Waits for the end of the run and returns its exit code."""
        self.output += self.process.communicate(timeout=600)[0]
        return self.process.returncode


class Page:
    """A WebSocket, opened as by the viewer's page."""

    def __init__(self, server, **changed):
        self.line = server.connect()
        self.rest = b""
        self.serial = 0
        headers = {
            "Connection": "Upgrade",
            "Upgrade": "websocket",
            "Origin": f"http://{server.host}",
            "Sec_WebSocket_Version": "13",
            "Sec_WebSocket_Protocol": "pags",
            "Sec_WebSocket_Key": base64.b64encode(os.urandom(16)).decode(),
        }
        headers.update(changed)
        self.line.sendall(f"GET /socket HTTP/1.1\r\n{server.headers(**headers)}\r\n".encode())
        head = b""
        while b"\r\n\r\n" not in head:
            try:
                chunk = self.line.recv(4096)
            except (ConnectionResetError, TimeoutError):
                chunk = b""
            if not chunk:
                break
            head += chunk
        head, _, self.rest = head.partition(b"\r\n\r\n")
        self.open = head.startswith(b"HTTP/1.1 101")
        self.line.settimeout(PATIENCE)

    def close(self):
        self.line.close()

    def frame(self, payload, opcode=1, final=True, masked=True, reserved=0):
        """Sends one frame."""
        head = bytes([final << 7 | reserved << 4 | opcode])
        size = len(payload)
        mark = 0x80 if masked else 0
        head += (
            bytes([mark | size])
            if size < 126
            else bytes([mark | 126]) + struct.pack(">H", size)
            if size < 65536
            else bytes([mark | 127]) + struct.pack(">Q", size)
        )
        if masked:
            mask = os.urandom(4)
            payload = mask + bytes(b ^ mask[i % 4] for i, b in enumerate(payload))
        self.line.sendall(head + payload)

    def say(self, **message):
        self.frame(json.dumps(message).encode())

    def take(self, size):
        while len(self.rest) < size:
            self.line.settimeout(max(self.end - time.monotonic(), 0.001))
            chunk = self.line.recv(65536)
            if not chunk:
                raise EOFError("the server closed the line")
            self.rest += chunk
        taken, self.rest = self.rest[:size], self.rest[size:]
        return taken

    def receive(self, timeout=PATIENCE):
        """Returns the next message as (opcode, bytes), or None if none arrives in time. Answers pings. Raises EOFError
        when the server has closed the connection."""
        self.end = time.monotonic() + timeout
        whole, kind = b"", 0
        try:
            while True:
                first, second = self.take(2)
                size = second & 127
                if size > 125:
                    size = struct.unpack(">H" if size == 126 else ">Q", self.take(2 if size == 126 else 8))[0]
                payload = self.take(size)
                opcode = first & 15
                if opcode == 9:
                    self.frame(payload, 10)
                    continue
                if opcode == 8:
                    raise EOFError(payload[2:].decode("utf-8", "replace"))
                kind, whole = kind or opcode, whole + payload
                if first & 128:
                    return kind, whole
        except TimeoutError:
            return None
        except ConnectionResetError as error:
            raise EOFError(str(error)) from error

    def look(self, camera, **more):
        """Requests a view from a camera. Returns the serial number of the request."""
        self.serial += 1
        self.say(type="look", serial=self.serial, camera=camera, **more)
        return self.serial

    def picture(self, timeout=PATIENCE, acknowledge=True):
        """Returns the facts and the JPEG file of the next picture, or None if none arrives in time."""
        message = self.receive(timeout)
        if message is None:
            return None
        kind, data = message
        if kind != 2:
            raise AssertionError(f"expected a picture, got {data[:300]!r}")
        size = struct.unpack("<I", data[:4])[0]
        facts = json.loads(data[4 : 4 + size])
        if acknowledge:
            self.say(type="got", serial=facts["serial"])
        return facts, data[4 + size :]

    def sharp(self, camera, **more):
        """Requests a view and returns its sharp picture."""
        serial = self.look(camera, **more)
        while True:
            facts, jpeg = self.picture()
            if facts["serial"] == serial and facts["sharp"]:
                return facts, jpeg

    def answer(self):
        """Returns the next text message as JSON. Acknowledges the pictures before it."""
        while True:
            kind, data = self.receive()
            if kind == 1:
                return json.loads(data)
            size = struct.unpack("<I", data[:4])[0]
            self.say(type="got", serial=json.loads(data[4 : 4 + size])["serial"])


def jpeg_size(jpeg):
    """Returns the width and height of a JPEG file, read from its frame header."""
    at = 2
    while at + 9 < len(jpeg):
        marker, size = jpeg[at + 1], struct.unpack(">H", jpeg[at + 2 : at + 4])[0]
        if 0xC0 <= marker <= 0xC2:
            height, width = struct.unpack(">HH", jpeg[at + 5 : at + 9])
            return width, height
        at += 2 + size
    raise AssertionError("no frame header")


def main():
    """Runs the tests of the calling program, or skips them in a build without a server. The first argument is the
    program pags."""
    if len(sys.argv) > 1 and not sys.argv[1].startswith("-"):
        fixtures.PAGS = os.path.abspath(sys.argv.pop(1))
    if "this build lacks libwebsockets" in fixtures.run("--help").stdout:
        print("skipped: this build has no pags view")
        sys.exit(77)
    unittest.main(module="__main__", verbosity=2)
