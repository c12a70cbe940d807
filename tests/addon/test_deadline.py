# SPDX-License-Identifier: Apache-2.0
"""Tests pags.Deadline in plain Python: how a deadline reduces a picture's quality, and which area the picture
covers."""

import math
import os
import sys

sys.path.insert(0, os.path.dirname(os.path.abspath(__file__)))

from test_module import ModuleCase, fixtures, make_camera, pags, pixel  # noqa: E402


class Deadlines(ModuleCase):
    """Tests pictures under a deadline: they are coarser where time is short, but cover the requested area."""

    def drawn(self, deadline, times, **arguments):
        renderer = pags.Renderer(threads=1)
        return [
            renderer.submit(self.scene, make_camera(time=101.0), deadline=deadline, **arguments).take()
            for _ in range(times)
        ]

    def test_long_deadline_gives_up_only_bounded_early_z(self):
        deadline = pags.Deadline(1e6)
        first, *_, last = self.drawn(deadline, 12)
        self.assertEqual((first.stats["divisor"], first.width), (2, 51))  # the speed isn't known yet
        self.assertEqual(
            (last.stats["step"], last.stats["divisor"], last.width, last.place), (1, 1, 101, (0, 0, 101, 101))
        )
        sharp = pags.render(self.scene, make_camera(time=101.0))
        self.assertEqual((sharp.stats["step"], sharp.place), (0, (0, 0, 101, 101)))
        for x, y in ((50, 50), (35, 50), (90, 90)):
            for a, b in zip(pixel(last.rgba, x, y), pixel(sharp.rgba, x, y)):
                self.assertLess(abs(a - b), 1 / 255 + 1e-3)

    def test_impossible_deadline_gets_quarter_size(self):
        deadline = pags.Deadline(1e-6)
        last = self.drawn(deadline, 3, outputs=("rgba", "depth"))[-1]
        self.assertEqual((last.stats["step"], last.stats["divisor"], deadline.step), (11, 4, 11))
        self.assertEqual((last.width, last.height, last.place), (25, 25, (0, 0, 101, 101)))
        self.assertEqual((last.rgba.shape, last.depth.shape), ((25, 25, 4), (25, 25)))
        # the pixel shows the car, which is at (50, 50) of the requested picture
        red, green, blue, alpha = pixel(last.rgba, 12, 12)
        self.assertGreater(red, 0.5)
        self.assertLess(green, 0.2)
        self.assertAlmostEqual(pixel(last.depth, 12, 12, 1)[0], 10, places=1)
        deadline.ms = 1e6  # quality returns step by step
        self.assertEqual([p.stats["step"] for p in self.drawn(deadline, 12)], [*range(11, 0, -1), 1])

    def test_a_window_keeps_its_place(self):
        """The smaller picture has whole pixels that cover the window."""
        last = self.drawn(pags.Deadline(1e-6), 3, window=(33, 20, 21, 41))[-1]
        x, y, width, height = last.place
        self.assertTrue(29 <= x <= 33 and 16 <= y <= 20, last.place)
        self.assertTrue(54 <= x + width <= 58 and 61 <= y + height <= 65, last.place)
        self.assertEqual((last.width, last.height), (round(width * 25 / 101), round(height * 25 / 101)))
        self.assertGreater(pixel(last.rgba, 12 - round(x * 25 / 101), 12 - round(y * 25 / 101))[0], 0.5)

    def test_passes_give_up_only_size(self):
        last = self.drawn(pags.Deadline(1e-6), 3, outputs=("rgba", "count"))[-1]
        small = {**make_camera(time=101.0), "width": 25, "height": 25}
        for name in ("fx", "fy", "cx", "cy"):
            small[name] *= 25 / 101
        sharp = pags.render(self.scene, small, outputs=("rgba", "count"))
        for name in ("rgba", "count"):
            self.assertEqual(
                bytes(memoryview(getattr(last, name)).cast("B")), bytes(memoryview(getattr(sharp, name)).cast("B"))
            )

    def test_several_scenes(self):
        """Several scenes are drawn at every step. Sampled steps use the priorities of all scenes."""
        other = pags.load(self.path("scene"))
        pose = [1, 0, 0, 0, 0, 1, 0, 4.0, 0, 0, 1, 0]
        deadline = pags.Deadline(1e-6)
        self.drawn(deadline, 3)
        deadline.ms = 1e6
        seen = [
            p.stats["sampled"] for p in self.drawn(deadline, 12, others=[{"scene": other, "world_from_scene": pose}])
        ]
        self.assertEqual(sum(seen), 3)

    def test_slow_pictures_get_less_time(self):
        deadline = pags.Deadline(50)
        for _ in range(100):
            deadline.pace(120, 95)
        self.assertEqual(deadline.haste, 0.25)
        deadline.pace(5000, 95)  # a pause between two movements is ignored
        deadline.pace(90, 95)  # a picture as fast as requested changes nothing
        self.assertEqual(deadline.haste, 0.25)
        for _ in range(100):
            deadline.pace(50, 95)
        self.assertEqual(deadline.haste, 1)

    def test_errors(self):
        for value, kind in (
            (0, ValueError),
            (-1, ValueError),
            (math.nan, ValueError),
            (math.inf, ValueError),
            ("soon", TypeError),
        ):
            with self.assertRaises(kind):
                pags.Deadline(value)
            with self.assertRaises(kind):
                pags.Deadline(1).ms = value
        with self.assertRaises(AttributeError):
            del pags.Deadline(1).ms
        for keywords, kind, words in (
            (dict(deadline=50), TypeError, "Deadline"),
            (dict(deadline=pags.Deadline(50), early_z="paper"), ValueError, "paper"),
        ):
            with self.assertRaisesRegex(kind, words):
                pags.render(self.scene, make_camera(), **keywords)


if __name__ == "__main__":
    fixtures.main()
