"""pags bench render: its table, CSV, JSON and plot. No time is asserted."""

import csv
import json
import xml.dom.minidom

import fixtures
from fixtures import Case, ply_bytes, read, some_splats


class Bench(Case):
    def render(self, *more):
        scene = self.write("a.ply", ply_bytes(some_splats()))
        return ["bench", "render", scene, "-n", 2, "-r", 2, "--sizes", "64x48,96x54", *more]

    def test_files(self):
        files = ["--csv", self.path("a.csv"), "--plot", self.path("a.svg"), "--json", self.path("a.json")]
        done = self.succeeds(*self.render("--modes", "off,exp3,sh0,lossless,bounded=0.02", *files))
        told = json.loads(read(self.path("a.json")))
        self.assertEqual([(s["width"], s["height"]) for s in told["sizes"]], [(64, 48), (96, 54)])
        for size in told["sizes"]:
            off, fast, flat, lossless, bounded = size["modes"]
            self.assertEqual([m["mode"] for m in size["modes"]], ["off", "exp3", "sh0", "lossless", "bounded=0.02"])
            self.assertEqual((off["psnr"], off["max_error"], off["differing"]), (None, 0, 0))
            self.assertEqual(off["speed_up"], 1)
            self.assertEqual(flat["differing"], 0)  # the splats are of degree 0
            self.assertTrue(0 < fast["max_error"] < 0.01 and fast["psnr"] > 50)
            self.assertEqual((lossless["differing"], lossless["max_alpha_error"]), (0, 0))
            self.assertTrue(bounded["max_error"] <= 0.021)
            self.assertEqual((off["gaussians"], off["in_view"], off["hidden"]), (40, off["loaded"], 0))
            self.assertTrue(0 < off["pairs_blended"] <= off["pairs_evaluated"])
            self.assertTrue(size["gaussians_per_pixel"] > 0)
            self.assertTrue(off["ms"]["frame"]["low"] <= off["ms"]["frame"]["median"] <= off["ms"]["frame"]["high"])
        rows = list(csv.DictReader(read(self.path("a.csv")).decode().splitlines()))
        self.assertEqual([(r["width"], r["mode"]) for r in rows[:3]], [("64", "off"), ("64", "exp3"), ("64", "sh0")])
        self.assertEqual(len(rows), 10)
        self.assertEqual(rows[0]["psnr"], "inf")
        self.assertEqual(int(rows[5]["pairs_binned"]), told["sizes"][1]["modes"][0]["pairs_binned"])
        plot = xml.dom.minidom.parse(self.path("a.svg"))
        self.assertEqual(len(plot.getElementsByTagName("g")), 6)
        self.assertIn("speed-up", done.stdout)

    def test_wrong_usage(self):
        self.fails(self.render("--sizes", "64x"), "WIDTHxHEIGHT", code=2)
        self.fails(self.render("--repetitions", "0"), "repetitions", code=2)
        self.fails(self.render("--modes", "off,fast"), "got 'fast'")


if __name__ == "__main__":
    fixtures.main()
