#!/usr/bin/env python3
# SPDX-License-Identifier: Apache-2.0
"""view_rate.py PAGS SCENE [--size 960x540] [--clients N] [--seconds S] [--round-trip MS] [--mbit M] [--rate HZ]: what a page of pags view gets
while it orbits: pictures a second, milliseconds from a look to its picture, and to the sharp one after the last movement. Every page turns HZ
times a second round the point ahead of the scene's first camera, as the mouse does. --round-trip and --mbit put a slower line in between, in this
process. Decoding isn't counted. Prints one line of JSON a page."""

import argparse
import json
import math
import os
import queue
import socket
import sys
import threading
import time

sys.path.insert(0, os.path.join(os.path.dirname(os.path.abspath(__file__)), "..", "tests", "cli"))

import fixtures
from view_client import PATIENCE, Page, Server


def carry(source, sink, delay, rate):
    """Hands on what comes, each piece when a line of that rate (bytes a second) and delay (seconds) would have brought it."""
    pieces = queue.Queue()

    def deliver():
        while (piece := pieces.get()) is not None:
            time.sleep(max(0, piece[0] - time.monotonic()))
            try:
                sink.sendall(piece[1])
            except OSError:
                return
        try:
            sink.shutdown(socket.SHUT_WR)
        except OSError:
            pass

    threading.Thread(target=deliver, daemon=True).start()
    free = 0.0
    try:
        while data := source.recv(1448):
            free = max(free, time.monotonic()) + len(data) / rate
            while pieces.qsize() > 200:  # a line that is full takes no more: 200 packets wait at most
                time.sleep(0.001)
            pieces.put((free + delay, data))
    except OSError:
        pass
    pieces.put(None)


def slow_line(port, delay, rate):
    """Listens on a port of its own and carries everything to `port` and back; returns the port."""
    door = socket.create_server(("127.0.0.1", 0))

    def serve():
        while True:
            near, _ = door.accept()
            far = socket.create_connection(("127.0.0.1", port))
            for line in (near, far):
                line.setsockopt(socket.IPPROTO_TCP, socket.TCP_NODELAY, 1)
                line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 32768)
            threading.Thread(target=carry, args=(near, far, delay, rate), daemon=True).start()
            threading.Thread(target=carry, args=(far, near, delay, rate), daemon=True).start()

    threading.Thread(target=serve, daemon=True).start()
    return door.getsockname()[1]


def turned(pose, axis, angle, centre):
    """A pose turned about an axis through a point."""
    c, s = math.cos(angle), math.sin(angle)
    columns = [[pose[4 * i + k] - (centre[i] if k == 3 else 0) for i in range(3)] for k in range(4)]
    out = [0.0] * 12
    for k, v in enumerate(columns):
        across = [axis[1] * v[2] - axis[2] * v[1], axis[2] * v[0] - axis[0] * v[2], axis[0] * v[1] - axis[1] * v[0]]
        along = sum(a * b for a, b in zip(axis, v))
        for i in range(3):
            out[4 * i + k] = v[i] * c + across[i] * s + axis[i] * along * (1 - c) + (centre[i] if k == 3 else 0)
    return out


def orbit(server, description, size, seconds, rate, results):
    page = Page(server)
    start, up = description["start"], description["up"]
    fit = min(size[0] / start["width"], size[1] / start["height"])
    camera = {"width": size[0], "height": size[1], "fx": start["fx"] * fit, "fy": start["fy"] * fit, "cx": size[0] / 2, "cy": size[1] / 2}
    centre = [start["pose"][4 * i + 3] + description["distance"] * start["pose"][4 * i + 2] for i in range(3)]
    looked, pictures, latencies, steps, sizes = {}, 0, [], [], []
    stop = threading.Event()

    def move():
        n = 0
        while not stop.is_set():
            pose = turned(start["pose"], up, 0.3 * math.sin(0.02 * n), centre)
            n += 1
            look = {"camera": {**camera, "pose": pose, **({} if start["time"] is None else {"time": start["time"]})}}
            looked[page.serial + 1] = time.monotonic()
            page.look(look["camera"])
            time.sleep(1 / rate)

    mover = threading.Thread(target=move)
    mover.start()
    begun = time.monotonic()
    while time.monotonic() < begun + seconds:
        facts, jpeg = page.picture()
        if time.monotonic() > begun + 1:  # the first second warms up
            pictures += 1
            latencies.append(time.monotonic() - looked[facts["serial"]])
            steps.append(facts["step"])
            sizes.append((facts["width"], len(jpeg)))
    stop.set()
    mover.join()
    last = time.monotonic()
    while not page.picture()[0]["sharp"]:
        pass
    sharp = time.monotonic() - last
    latencies.sort()
    results.append({
        "pictures_a_second": round(pictures / (seconds - 1), 2),
        "latency_ms_median": round(1000 * latencies[len(latencies) // 2], 1),
        "latency_ms_95": round(1000 * latencies[int(0.95 * (len(latencies) - 1))], 1),
        "sharp_after_ms": round(1000 * sharp, 1),
        "mean_step": round(sum(steps) / len(steps), 2),
        "mean_width": round(sum(width for width, _ in sizes) / len(sizes)),
        "mean_kilobytes": round(sum(size for _, size in sizes) / len(sizes) / 1000, 1),
    })
    page.close()


def main():
    parser = argparse.ArgumentParser(description=__doc__.split(":", 1)[1])
    parser.add_argument("pags")
    parser.add_argument("scene")
    parser.add_argument("--size", default="960x540")
    parser.add_argument("--clients", type=int, default=1)
    parser.add_argument("--seconds", type=float, default=15)
    parser.add_argument("--round-trip", type=float, default=0, help="milliseconds added")
    parser.add_argument("--mbit", type=float, default=0, help="Mbit/s of the line; 0: as it is")
    parser.add_argument("--rate", type=float, default=60, help="looks a second")
    arguments = parser.parse_args()
    fixtures.PAGS = os.path.abspath(arguments.pags)
    size = [int(v) for v in arguments.size.split("x")]
    server = Server(arguments.scene)
    try:
        description = json.loads(server.get("/scene.json")[2])
        if arguments.round_trip or arguments.mbit:
            port = slow_line(server.port, arguments.round_trip / 2000, (arguments.mbit or 1e5) * 125000)
            server.connect = lambda: socket.create_connection(("127.0.0.1", port), timeout=PATIENCE)
        results = []
        pages = [threading.Thread(target=orbit, args=(server, description, size, arguments.seconds, arguments.rate, results)) for _ in range(arguments.clients)]
        for page in pages:
            page.start()
        for page in pages:
            page.join()
    finally:
        server.close()
    for result in results:
        print(json.dumps(result))


if __name__ == "__main__":
    main()
