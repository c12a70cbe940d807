# SPDX-License-Identifier: Apache-2.0
"""Tests the server of pags view: access, served files, pictures and picks over the WebSocket, and hostile clients."""

import concurrent.futures
import copy
import json
import os
import random
import re
import socket
import time

import fixtures
import scenes
from fixtures import Case
from view_client import Page, Server, jpeg_size, main

# The number of hostile requests in the last test; `make check-view` sends more.
HOSTILE = int(os.environ.get("PAGS_VIEW_HOSTILE", "150"))
AT_ONCE = 32  # hostile requests at a time
CROWD = 1000 if HOSTILE > 1000 else 100  # connections at a time; the server keeps 900
GROWTH = 48 << 20  # bytes by which memory may grow: pictures of several sizes, and blocks that malloc keeps


class ViewCase(Case):
    options = ()

    @classmethod
    def setUpClass(cls):
        cls.scene = scenes.make_scene(os.path.join(cls.shared_folder(), "street"))
        cls.server = Server(cls.scene, *cls.options)
        cls.addClassCleanup(cls.server.close)
        cls.description = json.loads(cls.server.get("/scene.json")[2])

    def page(self, **changed):
        page = Page(self.server, **changed)
        self.addCleanup(page.close)
        return page

    def camera(self, index=0, time=0.0):
        return {**self.description["views"][index]["camera"], "time": time}


class Door(ViewCase):
    """Tests access rules and the files that are served."""

    def test_page_by_token_and_files_by_cookie(self):
        status, headers, body = self.server.get(f"/?token={self.server.token}", Cookie=None)
        self.assertEqual(status, 200)
        self.assertIn(b"<main", body)
        self.assertEqual(headers["set-cookie"], f"{self.server.cookie}; HttpOnly; SameSite=Strict; Path=/")
        self.assertIn("default-src 'self'", headers["content-security-policy"])
        self.assertIn("frame-ancestors 'none'", headers["content-security-policy"])
        self.assertEqual(headers["x-content-type-options"], "nosniff")
        self.assertEqual(headers["cache-control"], "no-store")
        names = set(re.findall(r'(?:src|href)="([\w.]+)"', body.decode()))
        seen = set()
        while names - seen:
            name = sorted(names - seen)[0]
            seen.add(name)
            status, headers, body = self.server.get(f"/{name}")
            self.assertEqual(status, 200, name)
            self.assertNotIn("set-cookie", headers)
            self.assertEqual(int(headers["content-length"]), len(body), name)
            names |= set(re.findall(r"from '\./([\w.]+)'", body.decode()))
            self.assertNotRegex(
                body.decode().replace("http://www.w3.org/2000/svg", ""), r"https?://", f"{name} leads elsewhere"
            )
        self.assertGreaterEqual(len(seen), 8, seen)

    def test_nothing_inline_that_the_policy_forbids(self):
        page = self.server.get("/")[2].decode()
        self.assertNotRegex(page, r"<script(?![^>]*src=)|\son\w+=|style=")

    def test_description(self):
        self.assertEqual(self.description["name"], "street")
        self.assertEqual(
            [item["id"] for item in self.description["objects"]], ["parked_0", "car_1", "three_2", "flat_3", "empty_4"]
        )
        self.assertEqual([item["gaussians"] for item in self.description["objects"]], [900, 900, 3, 361, 0])
        self.assertEqual(len(self.description["views"]), 30)
        self.assertEqual(len(self.description["objects"][1]["track"]), 10)
        self.assertEqual(self.description["up"], [0, 0, 1])

    def test_tokens(self):
        wrong = "0" * len(self.server.token)
        for path, cookie in [
            ("/", None),
            (f"/?token={wrong}", None),
            (f"/?token={self.server.token[:-1]}", None),
            ("/?token=", None),
            (f"/?token={self.server.token}0", None),
            ("/scene.json", f"pags_{self.server.port}={wrong}"),
            ("/scene.json", f"pags_1={self.server.token}"),
            ("/main.js", self.server.token),
            ("/", "x" * 3000),
        ]:
            status, headers, body = self.server.get(path, Cookie=cookie)
            self.assertEqual(status, 403, (path, cookie))
            self.assertNotIn("set-cookie", headers)
            self.assertNotIn(self.server.token.encode(), body)
        self.assertEqual(self.server.get("/", Cookie=f"a=b; {self.server.cookie}; c=d")[0], 200)

    def test_hosts(self):
        for host in [
            "evil.example",
            f"evil.example:{self.server.port}",
            "127.0.0.1",
            f"127.0.0.1:{self.server.port + 1}",
            f"127.0.0.1:{self.server.port}.evil.example",
            None,
        ]:
            self.assertIn(self.server.get("/scene.json", Host=host)[0], (0, 400, 403), host)
        for host in [f"localhost:{self.server.port}", f"LOCALHOST:{self.server.port}"]:
            self.assertEqual(self.server.get("/scene.json", Host=host)[0], 200, host)

    def test_paths_and_methods(self):
        for path in [
            "/nothing",
            "/../scene.json/x",
            "/..%2f..%2fetc/passwd",
            "/%2e%2e/%2e%2e/etc/passwd",
            "//etc/passwd",
            "/etc/passwd",
            "/index.html%00",
            "/background.ply",
            "/page/index.html",
            "/" + "a" * 200,
        ]:
            status, _, body = self.server.get(path)
            self.assertIn(status, (0, 400, 403, 404), path)
            self.assertNotIn(b"root:", body)
        for method in ["POST", "PUT", "DELETE", "OPTIONS", "TRACE", "BREW"]:
            self.assertIn(
                self.server.get("/scene.json", method=method, Content_Length="0")[0], (0, 400, 403, 404, 405), method
            )
        self.assertEqual(self.server.get("/scene.json")[0], 200)

    def test_socket_only_for_our_page(self):
        self.assertTrue(self.page().open)
        for changed in [
            {"Cookie": None},
            {"Cookie": "pags=1"},
            {"Origin": None},
            {"Origin": "http://evil.example"},
            {"Origin": "null"},
            {"Origin": f"http://127.0.0.1:{self.server.port + 1}"},
            {"Host": "evil.example"},
            {"Origin": f"http://evil.example@{self.server.host}"},
            {"Sec_WebSocket_Protocol": "other"},
        ]:
            self.assertFalse(self.page(**changed).open, changed)


class Pictures(ViewCase):
    """Tests the pictures that the server draws for a page."""

    def test_first_picture_then_a_sharp_one(self):
        page = self.page()
        begun = time.monotonic()
        serial = page.look(self.camera())
        facts, jpeg = page.picture()
        took = time.monotonic() - begun
        self.assertEqual((facts["serial"], facts["sharp"]), (serial, False))
        self.assertLess(took, 10)
        facts, jpeg = page.picture()
        self.assertEqual((facts["serial"], facts["sharp"], facts["step"]), (serial, True, 0))
        self.assertEqual(jpeg_size(jpeg), (160, 120))
        self.assertEqual((facts["width"], facts["height"]), (160, 120))
        self.assertEqual(facts["gaussians"], self.description["gaussians"])
        self.assertIsNone(page.picture(timeout=0.5), "a picture that nobody asked for")

    def test_picture_shows_the_requested_view(self):
        page = self.page()
        first = page.sharp(self.camera())[1]
        self.assertEqual(page.sharp(self.camera())[1], first)
        seen = {first}
        for more in [
            {"channel": "depth"},
            {"channel": "priority"},
            {"channel": "critical"},
            {"channel": "object"},
            {"channel": "size"},
            {"hidden": [1]},
            {"solo": 1},
        ]:
            jpeg = page.sharp(self.camera(), **more)[1]
            self.assertNotIn(jpeg, seen, more)
            seen.add(jpeg)
        self.assertNotIn(page.sharp(self.camera(time=0.6))[1], seen, "the cars don't move")
        self.assertNotIn(page.sharp(self.camera(1))[1], seen, "the camera doesn't turn")
        self.assertEqual(page.sharp(self.camera())[1], first)

    def test_early_z_off_draws_the_same(self):
        page = self.page()
        facts, jpeg = page.sharp(self.camera())
        without, same = page.sharp(self.camera(), earlyZ=False)
        self.assertEqual(jpeg, same)
        self.assertEqual((without["hidden"], without["clustersHidden"]), (0, 0))
        self.assertGreaterEqual(without["shaded"], facts["shaded"])
        page.look(self.camera(), earlyZ=False)
        moving = page.picture()[0]
        self.assertEqual((moving["sharp"], moving["step"]), (False, 0), "what it saves is seen in moving pictures, too")

    def test_objects_are_hidden_for_one_page_only(self):
        one, other = self.page(), self.page()
        before = one.sharp(self.camera())[1]
        self.assertNotEqual(other.sharp(self.camera(), hidden=[0, 1, 2, 3, 4])[1], before)
        self.assertEqual(one.sharp(self.camera())[1], before)

    def test_pick(self):
        page = self.page()
        camera = self.camera()
        page.look(camera)
        pose, place = camera["pose"], [row[1:] for row in self.description["objects"][0]["track"]][0]
        away = [place[4 * i + 3] - pose[4 * i + 3] for i in range(3)]
        x, y, z = (sum(pose[4 * i + c] * away[i] for i in range(3)) for c in range(3))
        at = {"x": camera["cx"] + camera["fx"] * x / z, "y": camera["cy"] + camera["fy"] * y / z}
        page.say(type="pick", serial=77, **at)
        found = page.answer()
        self.assertEqual((found["type"], found["serial"], found["hit"], found["object"]), ("picked", 77, True, 0))
        self.assertLess(max(abs(found["point"][i] - place[4 * i + 3]) for i in range(3)), 2.2)
        self.assertLess(abs(found["depth"] - z), 2.2)
        page.look(camera, hidden=[0])
        page.say(type="pick", serial=78, **at)
        self.assertNotEqual(page.answer().get("object"), 0)
        page.look(camera)
        page.say(type="pick", serial=79, x=80, y=-5000)
        self.assertFalse(page.answer()["hit"])

    def test_no_queue_of_old_pictures(self):
        page = self.page()
        page.look(self.camera())
        self.assertIsNotNone(page.picture(acknowledge=False))
        for i in range(30):
            last = page.look(self.camera(time=0.02 * i))
        self.assertIsNone(page.picture(timeout=1), "a second picture before the first was acknowledged")
        page.say(type="got", serial=999999)
        self.assertIsNone(page.picture(timeout=0.5), "a serial that was never sent counts")
        page.say(type="got", serial=1)
        self.assertEqual(page.picture()[0]["serial"], last)

    def test_missing_photographs(self):
        page = self.page()
        page.look(self.camera(), channel="photograph", view=0)
        self.assertIn("--dataset", page.answer()["text"])
        page.look(self.camera(), channel="difference", view=4000)
        self.assertEqual(page.answer()["type"], "error")
        page.sharp(self.camera())

    def test_slow_page_does_not_delay_others(self):
        slow = self.page()
        slow.line.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 2048)
        for _ in range(40):
            slow.look(self.camera(), channel="depth")
        page = self.page()
        for i in range(10):
            page.sharp(self.camera(time=0.05 * i))


class Photographs(Case):
    def test_compare_with_photographs(self):
        data, scene = fixtures.make_dataset(self.path("data"), views=9), self.path("scene")
        self.succeeds("train", data, "-o", scene, "-n", 60, *fixtures.SMALL, "-q")
        server = Server(scene)
        self.addCleanup(server.close)
        views = json.loads(server.get("/scene.json")[2])["views"]
        held = next(i for i, view in enumerate(views) if view["test"])
        page = Page(server)
        self.addCleanup(page.close)
        facts, difference = page.sharp(views[held]["camera"], channel="difference", view=held)
        _, photograph = page.sharp(views[held]["camera"], channel="photograph", view=held)
        self.assertNotEqual(difference, photograph)
        self.assertEqual(jpeg_size(photograph), (views[held]["camera"]["width"], views[held]["camera"]["height"]))
        report = self.path("eval.json")
        self.succeeds("eval", scene, "--split", "test", "--json", report, "-q")
        listed = {view["name"]: view["psnr"] for view in json.loads(fixtures.read(report))["test"]["per_view"]}
        self.assertAlmostEqual(facts["psnr"], listed[views[held]["name"]], delta=0.01)


class Crowd(ViewCase):
    options = ("--clients", "2")

    def test_number_of_pages_is_limited(self):
        pages = [self.page(), self.page()]
        pages[0].sharp(self.camera())
        third = self.page()
        with self.assertRaises(EOFError) as closed:
            third.receive()
        self.assertIn("--clients", str(closed.exception))
        pages[1].close()
        end = time.monotonic() + 20
        while True:  # the seat is free when the server has noticed the closed connection
            page = self.page()
            try:
                page.sharp(self.camera())
                break
            except EOFError:
                self.assertLess(time.monotonic(), end)
                time.sleep(0.1)


class Hostile(ViewCase):
    """Hostile clients can't end the server or make its memory grow. Other clients are served meanwhile."""

    options = ("--clients", "64")  # more clients than hostile pages at a time

    def alive(self):
        page = self.page()
        page.sharp(self.camera())
        page.close()

    def ends(self, page):
        """Tells whether the server closes the connection."""
        try:
            while page.receive(timeout=20) is not None:
                pass
        except EOFError:
            return True
        return False

    def test_broken_frames(self):
        for name, send in {
            "reserved bits": lambda page: page.frame(b"{}", reserved=7),
            "unknown opcode": lambda page: page.frame(b"{}", opcode=5),
            "binary": lambda page: page.frame(b"{}", opcode=2),
            "too large": lambda page: page.frame(b" " * 20000),
            "too large in pieces": lambda page: [
                page.frame(b" " * 3000, opcode=0 if i else 1, final=False) for i in range(8)
            ],
            "endless length": lambda page: page.line.sendall(
                b"\x81\xff\x7f\xff\xff\xff\xff\xff\xff\xff" + bytes(20000)
            ),
            "long ping": lambda page: page.frame(b"x" * 3000, opcode=9),
            "noise": lambda page: page.line.sendall(bytes(random.Random(1).randbytes(4000))),
        }.items():
            page = self.page()
            try:
                send(page)
            except (BrokenPipeError, ConnectionResetError):
                pass
            self.assertTrue(self.ends(page), name)
            self.alive()

    def test_invalid_messages(self):
        camera = self.camera()
        bad = [
            "",
            "{",
            "[]",
            "null",
            '"look"',
            "{}",
            '{"type": "look"}',
            '{"type": "dance", "serial": 1}',
            '{"type": "got", "serial": -1}',
            '{"type": "got", "serial": 1e400}',
            '{"type": "pick", "serial": 1, "x": 1e300, "y": 0}',
            "[" * 5000,
            json.dumps({"type": "look", "serial": 1, "camera": {**camera, "width": 100000}}),
            json.dumps({"type": "look", "serial": 1, "camera": {**camera, "width": 0}}),
            json.dumps({"type": "look", "serial": 1, "camera": {**camera, "fx": 0}}),
            json.dumps({"type": "look", "serial": 1, "camera": {**camera, "pose": [0] * 12}}),
            json.dumps({"type": "look", "serial": 1, "camera": {**camera, "pose": [1e300] * 12}}),
            json.dumps({"type": "look", "serial": 1, "camera": camera, "channel": "smell"}),
            json.dumps({"type": "look", "serial": 1, "camera": camera, "hidden": list(range(2000))}),
            json.dumps({"type": "look", "serial": 1, "camera": camera, "hidden": [-1]}),
        ]
        page = None
        for i, text in enumerate(bad):
            if i % 10 == 0:
                page = self.page()
            page.frame(text.encode())
            self.assertEqual(page.answer()["type"], "error", text[:80])
            page.sharp(camera)
        page = self.page()
        for _ in range(40):
            try:
                page.frame(b"{")
            except (BrokenPipeError, ConnectionResetError):
                break
        self.assertTrue(self.ends(page), "a page that only sends nonsense stays")
        self.alive()

    def test_extreme_views(self):
        page, camera = self.page(), self.camera()
        for change in [
            {"width": 1, "height": 1},
            {"fx": 1e6, "fy": 1e6},
            {"fx": 0.01, "fy": 0.01},
            {"cx": -1e6},
            {"time": 1e300},
            {"time": -1e300},
            {"pose": camera["pose"][:3] + [1e11] + camera["pose"][4:]},
        ]:
            page.sharp({**camera, **change})
        page.sharp(camera, solo=2000000000, hidden=[2147483646])

    def requests(self, count):
        """Returns functions that send hostile requests, the same in each run. Many requests leave the server waiting
        for more data. So the functions wait only shortly for an answer."""
        dice = random.Random(41)
        hasty = copy.copy(self.server)
        hasty.patience = 0.2

        def http(path="/", method="GET", **changed):
            return lambda: hasty.get(path, method=method, **changed)

        def raw(data):
            return lambda: hasty.send(data)

        def silent():
            with hasty.connect() as line:
                line.sendall(b"GET / HT")

        def deaf():
            page = Page(hasty)
            if page.open:
                for _ in range(5):
                    page.look(self.camera())
            page.close()

        def broken(data):
            def send():
                page = Page(hasty)
                if page.open:
                    page.line.sendall(data)
                page.close()

            return send

        kinds = [
            lambda: http("/" + "".join(dice.choice("./%2e\\~abc?#&=") for _ in range(dice.randrange(1, 60)))),
            lambda: http(
                "/?token=" + "".join(dice.choice("0123456789abcdef") for _ in range(dice.choice([1, 48, 400])))
            ),
            lambda: http("/", Host=dice.choice(["evil.example", "", "127.0.0.1", "[::1]", "a" * 300])),
            lambda: http("/", X_Long="y" * dice.choice([100, 5000, 20000])),
            lambda: http("/", **{f"X_{i}": "z" for i in range(dice.randrange(1, 200))}),
            lambda: http("/" + "a" * dice.randrange(1, 8000)),
            lambda: http("/", method=dice.choice(["POST", "PUT", "CONNECT", "PRI", "G E T", "\x00"])),
            lambda: raw(b"PRI * HTTP/2.0\r\n\r\nSM\r\n\r\n" + bytes(40)),
            lambda: http(
                "/", Connection="Upgrade, HTTP2-Settings", Upgrade="h2c", HTTP2_Settings="AAMAAABkAARAAAAAAAIAAAAA"
            ),
            lambda: http("/scene.json", Content_Length=dice.choice(["-1", "99999999999999999999", "10"])),
            lambda: http(
                "/socket",
                Connection="Upgrade",
                Upgrade="websocket",
                Sec_WebSocket_Key="x",
                Sec_WebSocket_Version="99",
                Origin=f"http://{self.server.host}",
            ),
            lambda: http(f"/?token={self.server.token}", Host="evil.example", Cookie=None),
            lambda: silent,
            lambda: raw(dice.randbytes(dice.randrange(1, 3000))),
            lambda: deaf,
            lambda: broken(dice.randbytes(dice.randrange(1, 300))),
        ]
        return [dice.choice(kinds)() for _ in range(count)]

    def try_once(self, request):
        """Tells whether the request had an HTTP answer."""
        try:
            answer = request()
        except (OSError, EOFError):
            return False
        if answer:
            self.assertNotIn(self.server.token.encode(), answer[2])
        return bool(answer and answer[0])

    def test_many_hostile_requests(self):
        """Sends AT_ONCE requests at a time next to idle connections. Meanwhile a page is served again and again."""
        self.alive()
        for request in self.requests(50):
            self.try_once(request)
        before = self.server.memory()
        idle = [self.server.connect() for _ in range(300)]
        worst, pages = 0, 0
        with concurrent.futures.ThreadPoolExecutor(AT_ONCE) as pool:
            tried = [pool.submit(self.try_once, request) for request in self.requests(HOSTILE)]
            while pages < 3 or not all(one.done() for one in tried):
                begun = time.monotonic()
                self.alive()
                worst, pages = max(worst, time.monotonic() - begun), pages + 1
                time.sleep(0.2)
        answered = sum(one.result() for one in tried)
        for line in idle:
            line.close()
        self.alive()
        self.assertIsNone(self.server.process.poll(), "the server has died")
        grown = self.server.memory() - before
        self.assertGreater(
            answered, HOSTILE // 3, "they weren't let in to be answered"
        )  # half of the requests are HTTP requests
        print(
            f"{HOSTILE} hostile requests, {answered} answered: memory grew by {grown / 1e6:.1f} MB; each of {pages} pages beside them had its sharp picture in {worst:.2f} s at most"
        )
        self.assertLess(grown, GROWTH)

    def test_too_many_connections(self):
        """Opens more connections than the server keeps. Half of them send a part of a request. An open page is served
        meanwhile. A new page is served when idle connections have been dropped, and the memory is freed again."""
        page = self.page()
        page.sharp(self.camera())
        before = self.server.memory()
        lines = []
        for i in range(CROWD):
            lines.append(self.server.connect())
            if i % 2:
                lines[-1].sendall(b"GET / HTTP/1.1\r\nHost: ")
        begun = time.monotonic()
        for i in range(5):
            page.sharp(self.camera(time=0.1 * i))
        served = time.monotonic() - begun
        while not self.page().open:
            self.assertLess(time.monotonic() - begun, 25, "the server stays full of connections that ask for nothing")
        entered = time.monotonic() - begun
        grown = self.server.memory() - before
        for line in lines:
            line.close()
        self.alive()
        print(
            f"{CROWD} connections at once: five sharp pictures in {served:.2f} s beside them, a new page after {entered:.1f} s; memory grew by {grown / 1e6:.1f} MB"
        )
        self.assertLess(served, 10)
        self.assertLess(grown, GROWTH)


class Usage(Case):
    def test_ends_by_interrupt(self):
        server = Server(scenes.make_scene(self.path("street")))
        page = Page(server)
        page.look(json.loads(server.get("/scene.json")[2])["start"])
        code, errors = server.close()
        page.close()
        self.assertEqual((code, errors), (0, ""))

    def test_errors(self):
        scene = scenes.make_scene(self.path("street"))
        server = Server(scene)
        self.addCleanup(server.close)
        self.fails(["view", scene, "--port", server.port], f"127.0.0.1:{server.port}", "--port 0")
        self.fails(["view", scene, "--bind", "203.0.113.7"], "203.0.113.7", "isn't one of this machine")
        self.fails(["view", scene, "--bind", "0.0.0.0"], "--host", code=2)
        self.fails(["view", scene, "--colmap", "x"], "--dataset", code=2)
        self.fails(["view", scene, "--port", "0", "--host", ",".join("abcdefghijk")], "--host")
        self.fails(["view", self.path("nothing")], "nothing")
        packed = self.path("a.pagsz")
        self.succeeds("export", scene, packed, "-q")
        self.fails(["view", packed], "packed")

    def test_other_hosts(self):
        server = Server(scenes.make_scene(self.path("street")), "--host", "view.example,other.example:9000")
        self.addCleanup(server.close)
        for host, status in [
            ("view.example", 200),
            (f"view.example:{server.port}", 200),
            ("other.example:9000", 200),
            ("other.example", 403),
            ("example", 403),
        ]:
            self.assertEqual(server.get("/", Host=host)[0], status, host)

    def test_splat_files(self):
        ply = self.write("a.ply", fixtures.ply_bytes(fixtures.some_splats()))
        server = Server(ply)
        self.addCleanup(server.close)
        description = json.loads(server.get("/scene.json")[2])
        page = Page(server)
        self.addCleanup(page.close)
        page.sharp({**description["start"], "width": 64, "height": 48, "time": 0})
        self.assertEqual(description["objects"], [])


if __name__ == "__main__":
    main()
